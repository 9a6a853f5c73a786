"""The penalty method of Bourichi and Essoufi (2016), as printed, for linear elements on simplices.

:mod:`equations` has the forms in the order of the paper, from ``a(., .)`` to (26).  At a frozen
friction bound :mod:`newton` solves (26) by SNES, with steps to a critical point; :mod:`fixed_point`
updates the bound ``mu |R sigma_nu|`` around these solves, and :mod:`continuation` makes n larger
stage by stage.  :mod:`method` puts the three together, and :mod:`scope` says what they serve.
"""
