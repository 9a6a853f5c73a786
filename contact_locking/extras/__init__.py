"""What is made of solutions and results, and what no solve needs: pictures and reports."""
