class Monitor:
    def message(self, text): pass
    def stage(self, index, count, n, epsilon): pass
    def friction_update(self, k, change, factor): pass
    def iteration(self, k, residual): pass
