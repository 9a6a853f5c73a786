"""A primal-dual interior point method for the contact problem, for any n up to infinity."""
