# %% [markdown]
# # What if friction weakens as the surfaces slide?
#
# In many materials friction falls as surfaces begin to slide. The coefficient may depend on the
# slip $s = |u_\tau|$; here it falls from $\mu_0$ to $\mu_1$ over a slip of about $s_0$:
#
# $$\mu(s) = \mu_0 - (\mu_0 - \mu_1)\left(1 - e^{-s/s_0}\right), \qquad
#   |\mu(s) - \mu(t)| \le L_\mu |s - t|, \qquad L_\mu = \frac{\mu_0 - \mu_1}{s_0}.$$
#
# The bound of friction then depends on the displacement twice, by the pressure and by the slip:
# $g(u) = \mu(|u_\tau|)\,|R\sigma_\nu(u)|$. With `solver.method: penalty`, which
# this study file has, the solver iterates to a fixed point. It solves with a frozen bound, which is
# a convex problem, and then computes the bound anew,
#
# $$g_{k+1} = \mu(|u_\tau(g_k)|)\,|R\sigma_\nu(u(g_k))|,$$
#
# until $g$ no longer changes. If this map contracts everywhere, the solution is unique; Theorem 4.1
# asks for $L_\mu + \mu^* < \alpha L^*$. The factor by which the changes shrink on the way to the
# solution can be observed: it is evidence and no proof.

# %%
import sys
from pathlib import Path

from mpi4py import MPI

from contact_locking import load, solve, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]
MU_0, MU_1 = 0.4, 0.1

comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
solution = solve(parameters, comm)
write(solution, parameters.output.directory)
assert solution.converged, solution.summary["reason"]
fixed_point = solution.summary["friction_fixed_point"]
if comm.rank == 0:
    updates = solution.summary["iterations"]["friction"]
    print(f"{updates} updates of the bound, contraction factor {fixed_point['contraction']:.2f}")
assert fixed_point["contraction"] < 0.5

# %% [markdown]
# ## The law, point by point
#
# On rank 0 the bound can be checked against the law: where the block has slipped farther,
# friction is closer to $\mu_1$ times the smoothed pressure. The block is clamped on the left and
# pulled at the right, so slip grows along it.

# %%
points = solution.contact_points
if points is not None:
    slip = abs(points.u_tangent[:, 0])
    count = len(slip)
    for i in (count // 4, count // 2, 3 * count // 4):
        print(
            f"x = {points.x[i, 0]:.2f}: slip {slip[i]:.5f}, "
            f"bound {points.bound[i]:.5f}, pressure {points.pressure[i]:.5f}, "
            f"ratio {points.bound[i] / points.pressure[i]:.3f}"
        )
    ratio = points.bound / points.pressure.clip(min=1e-12)
    assert slip[count // 4] < slip[count // 2] < slip[3 * count // 4]
    assert ratio[count // 4] > ratio[count // 2] > ratio[3 * count // 4]

# %% [markdown]
# ## Steeper laws
#
# With a smaller $s_0$ the constant $L_\mu$ grows, but the observed factor does not always grow with
# it. The factor is largest where $s_0$ is about as large as the slips; if $s_0$ is much smaller,
# nearly all points have slips for which $\mu$ is nearly constant again. The condition of the
# theorem is sufficient, not necessary. The friction force always lies between those for the
# constants $\mu_0$ and $\mu_1$.

# %%
cases = {"mu_0": f"{MU_0}", "mu_1": f"{MU_1}"} | {
    f"s_0 = {s_0:g}": f"{MU_0} - {MU_0 - MU_1}*(1 - exp(-s/{s_0}))" for s_0 in (0.05, 0.005, 0.0005)
}
force, factor = {}, {}
for name, law in cases.items():
    changes = [*CHANGES, f"friction.coefficient={law}"]
    case = solve(load(FILE, changes).parameters, comm).summary
    assert case["converged"], case["reason"]
    force[name] = -case["friction_force"][0]
    factor[name] = case["friction_fixed_point"]["contraction"]
    if comm.rank == 0:
        print(f"{name:12}  friction force {force[name]:.5f}  contraction {factor[name]:.2f}")
assert force["mu_1"] < force["s_0 = 0.0005"] < force["s_0 = 0.005"] < force["s_0 = 0.05"]
assert force["s_0 = 0.05"] < force["mu_0"]
assert factor["s_0 = 0.005"] > max(factor["s_0 = 0.05"], factor["s_0 = 0.0005"])
