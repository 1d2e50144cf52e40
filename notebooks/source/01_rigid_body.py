# %% [markdown]
# # 1 · Rigid bodies
#
# *A computer moves a box in small steps of time. Answer first<span class="kernel-only">, run the cells</span>, then
# press* Play *and watch.* About {open minutes} minutes of reading, cards and charts; the collapsed parts add
# {folded minutes}; exercises {exercise minutes}.

# %%
from course.cards import predict
from course.simulations import simulation

predict("energy_of_a_fall")

# %% [markdown]
# ![Rigid body simulator: bouncing box](attachment:rigid_body.bouncing_box.png)
#
# *Here the energy falls at the impacts, and should. The question is about the flight between them.*

# %%
simulation("bouncing_box")

# %% [markdown]
# **You will be able to** write the equations of motion of any rigid body and say where each term comes from; represent
# and update orientation without singularities or drift; choose an integrator by its measured error per unit of work;
# predict the step at which it fails, to half a percent; and name the cause when a simulation explodes, tunnels or
# gains energy. **Know first:** vectors, matrices, derivatives; Python with NumPy.
#
# ## How this chapter works
#
# Most scenes begin with a card: answer first; a click says whether you are right, and **Explanation** says why. Then
# you move something, learn its name, and see one number. Derivations are folded away. A number in the text comes from
# the cell above it, or from a check that `python -m course.derivations 1` runs again. The code is
# `course.rigid_body`, as the tests run it. These exercises wait in section 8:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(1)

# %%
import inspect
import textwrap

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import rigid_body
from course.cards import figures, interview
from course.charts import read
from course.charts.rigid_body import accuracy
from course.derivations import more_claims, show
from course.rigid_body import planar, problems, quaternion


def source(*functions):
    """Show functions as they stand in the module."""
    text = "\n\n".join(inspect.getsource(f) for f in functions)
    return Markdown(f"```python\n{text}```")


# %% [markdown]
# ## 1 · Concept: what moves, and by which law
#
# ### How much is there to know?

# %%
show("state_is_six_quantities")

# %% [markdown]
# A **rigid body** keeps its shape: its centre of mass goes along three axes, and the body turns about three. That is
# six ways to move. Newton's law is of second order, so you also need how fast each of the six changes. The **state**
# lives in twelve dimensions. How many *numbers* you store depends on how you write down an orientation. All the
# orientations together are called **SO(3)**: the rotations of space, which have three dimensions.
#
# | orientation stored as | numbers | whole state | what it costs you |
# |---|---|---|---|
# | three turns about axes, the **Euler angles** | 3 | 12 | a place where they fail |
# | unit **quaternion** (four numbers, below) | 4 | 13 | $\lvert q\rvert = 1$; $q$ and $-q$ are the same |
# | rotation matrix | 9 | 18 | six constraints |
#
# In the plane one angle is enough: position, angle and their rates make six numbers.

# %%
more_claims("state_with_quaternion", "planar_state")

# %% [markdown]
# ### Thrown, and left alone

# %%
show("free_body_keeps_angular_velocity")

# %%
simulation("free_body")

# %% [markdown]
# Without a torque the **angular momentum** $L = I\omega$ stays. Here $I$ is the **inertia tensor**, a symmetric
# matrix that says how the mass lies around its centre. It turns with the body. If $L$ must stay and $I$ turns, then
# $\omega$ has to move: the axis of rotation wanders although nothing pushes. Only about a **principal axis**, an
# eigenvector of $I$, are $L$ and $\omega$ parallel, and the axis rests.
#
# The laws are the **Newton-Euler equations**: momentum changes only by force, angular momentum (about the centre of
# mass) only by torque.
#
# $$\dot p = F, \qquad \dot L = \tau, \qquad p = m v, \quad L = I\omega .$$
#
# That is all the physics. The rest is a choice of where to stand. In the body's own frame $I$ is constant, and
#
# $$\boxed{\; m\dot v = F, \qquad I\dot\omega + \omega\times(I\omega) = \tau \;}$$
#
# <details><summary>Derive: where the extra term comes from</summary>
#
# The force equation is meant in the world. For the other, stand in the body. A vector that is constant in space seems
# to turn backwards there, so the rate of any vector picks up $\omega\times$ that vector: $\dot L$ in the world is
# $I\dot\omega + \omega\times(I\omega)$ in the body. Setting it equal to the torque gives the equation.
#
# The **gyroscopic term** $\omega\times(I\omega)$ is *not a force*. It is what a constant $L$ looks like to somebody
# who turns with the body. It vanishes where $L$ and $\omega$ are parallel: for a sphere or a cube always, for other
# bodies when they spin about a principal axis.
#
# </details>
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A free body keeps $L$, not $\omega$. The gyroscopic term is the price of standing in the body.
#
# </div>

# %%
more_claims("force_is_mass_times_acceleration", "planar_torque")

# %% [markdown]
# ### The brick that flips

# %%
predict("brick_that_flips")

# %%
simulation("flip")

# %% [markdown]
# Linearise the equations about a spin $\Omega$ on the middle axis: a disturbance grows like $e^{\sigma t}$.
#
# <details><summary>Derive: the rate of growth</summary>
#
# Let $I_1 < I_2 < I_3$ and $\omega = (\epsilon_1, \Omega, \epsilon_3)$ with small $\epsilon$. To first order
# $I_1\dot\epsilon_1 = (I_2 - I_3)\,\Omega\,\epsilon_3$ and $I_3\dot\epsilon_3 = (I_1 - I_2)\,\Omega\,\epsilon_1$: each
# feeds the other. Together
#
# $$\ddot\epsilon_1 = \sigma^2\epsilon_1, \qquad \sigma = \Omega\sqrt{\frac{(I_2-I_1)(I_3-I_2)}{I_1 I_3}} .$$
#
# If $I_2$ is the largest or the smallest of the three, the product under the root is negative: $\sigma$ is imaginary,
# a bounded wobble. The flip is regular, too: its period is an elliptic integral.
#
# </details>

# %%
show("principal_axis_is_stable")

# %%
more_claims("tumbling_is_irregular", "wobble_comes_from_the_term")

# %% [markdown]
# ### What keeps a spinning top up?

# %%
show("gyroscopic_term_holds_the_top_up")

# %%
simulation("top")

# %% [markdown]
# Gravity's torque on a top is *horizontal*. It can turn a large $L$ sideways, which is the slow circling called
# **precession**, but it cannot tip it quickly. How large the spin must be for an upright top is a condition that you
# should be able to write down.

# %%
show("top_condition")

# %%
more_claims(
    "euler_equation_point",
    "gyroscopic_term_always_there",
    "gyroscopic_term_is_negligible",
    "robotics_cannot_drop_the_term",
)

# %% [markdown]
# ### Can these inertias be real?

# %%
predict("inertia_of_a_thin_rod")

# %% [markdown]
# Moments of inertia are not three free numbers. Each is at most the sum of the other two, because all are made of
# squared distances. Robot descriptions in circulation violate it. `RigidBody` refuses them:

# %%
try:
    rigid_body.RigidBody(mass=1.0, inertia=(1.0, 1.0, 3.0))
except ValueError as problem:
    print(textwrap.fill(str(problem), 96))

# %% [markdown]
# And moments move with the point that you turn about. The **parallel axis** theorem: about an axis at distance $d$
# from the parallel one through the centre of mass, a moment is larger by $m d^2$. It holds between parallel axes. For
# the whole tensor, about a point displaced by the vector $d$, the gain is $m(d^2 1 - d\,d^\mathsf{T})$, which is
# nothing about the direction of $d$ itself.
#
# ### Three angles, and where they fail

# %%
show("gimbal_lock_rank")

# %% [markdown]
# Yaw, pitch and roll are turns about $z$, then the new $y$, then the new $x$. At a pitch of ninety degrees the first
# axis and the last fall on one line: **gimbal lock**.

# %%
show("gimbal_lock_is_physical")

# %%
simulation("gimbal")

# %% [markdown]
# A matrix $E$ takes angle rates to the angular velocity; $\det E = \pm\cos\theta$, and the weakest turn in the picture
# is its smallest **singular value**. At the lock its rank is two: one direction of $\omega$ has *no* finite rates. The
# body can still turn that way; the coordinates cannot follow.

# %%
for angle in (60.0, 89.0, 90.0):
    E = quaternion.euler_zyx_rate_matrix(np.radians(angle), 0.3)
    _, values, right = np.linalg.svd(E)
    rates = np.abs(right[2]) / max(values[2], 1e-12)  # for 1 rad/s about the axis that is hardest
    needed = f"{np.linalg.norm(rates):.1f} rad/s of all three angles, {rates[0]:.1f} of yaw alone"
    if values[2] < 1e-12:
        needed = "no finite rate"
    print(f"pitch {angle:.0f} deg, rank {np.linalg.matrix_rank(E)}: 1 rad/s takes {needed}")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Coordinates lock, bodies don't. No other choice of three angles escapes it.
#
# </div>

# %%
more_claims("gimbal_lock_at_one_attitude", "pointing_up_locks", "another_order_of_angles")

# %% [markdown]
# ### Four numbers without a lock

# %%
show("quaternion_is_unique")

# %%
simulation("double_cover")

# %% [markdown]
# Any orientation is one turn by an angle $\alpha$ about a unit axis $n$: the **axis-angle** form. A unit quaternion
# stores it with half the angle,
#
# $$q = (\cos\tfrac{\alpha}{2},\; n\sin\tfrac{\alpha}{2}) = \exp(\alpha n) .$$
#
# The last form is the **exponential map**, from a turn vector to its quaternion. Because of the half, a full turn
# takes $q$ to $-q$, and both are the same orientation: the **double cover**. So compare orientations by the angle
# between them, never by subtracting quaternions. **Rodrigues'** formula turns axis and angle into a matrix, with
# $[n]_\times$ the matrix of $n\times$. **SLERP** goes from one orientation to another at a constant rate, along the
# shorter way.

# %%
show("quaternion_has_no_lock")

# %%
axis, angle = np.array([2.0, -1.0, 2.0]) / 3.0, 0.7
K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
rodrigues = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
same = np.allclose(quaternion.to_matrix(quaternion.exp(angle * axis)), rodrigues, atol=1e-14)
print("Rodrigues' matrix is the quaternion's:", same)


def slerp(p, q, t):
    """Return from p (t = 0) to q (t = 1) at a constant rate, the shorter way."""
    q = q if p @ q >= 0.0 else -q
    return quaternion.product(
        p, quaternion.exp(t * quaternion.log(quaternion.product(quaternion.conjugate(p), q)))
    )


start, end = quaternion.identity(), quaternion.exp(2.8 * axis)
for name, quarter in (
    ("SLERP", slerp(start, end, 0.25)),
    ("mixed and scaled", 0.75 * start + 0.25 * end),
):
    turned = quaternion.angle_between(start, quaternion.normalise(quarter))
    print(f"a quarter of the way by {name:<16}: {turned / 2.8:.3f} of the angle")

# %% [markdown]
# ## 2 · Concept: how a computer moves it
#
# ### Two ways to take a step

# %%
show("swapping_two_lines")

# %% [markdown]
# An integrator turns the law into steps of length $h$ (in code and on charts: dt). **Explicit Euler** moves with the
# old velocity: $q' = q + hv$, then $v' = v + ha$, with $a$ the acceleration at $q$. **Semi-implicit Euler** has the two
# lines in the other order: $v' = v + ha$, then $q' = q + hv'$.

# %%
more_claims(
    "usual_listing_is_explicit",
    "explicit_energy_factor",
    "explicit_adds_always",
    "explicit_adds_without_forces",
)

# %% [markdown]
# ### Why the step has a limit

# %%
predict("spring_and_step")

# %%
simulation("spring")

# %% [markdown]
# Near a stable equilibrium every conservative system without gyroscopic forces is a set of springs, $\ddot x =
# -\omega^2 x$ with $\omega=\sqrt{k/m}$ and **stiffness** $k$. One step of a linear method is a matrix: $(x, v)' =
# A(\omega h)\,(x, v)$. The simulation is stable exactly when the powers of $A$ stay bounded: no eigenvalue outside
# the unit circle, and none on it that lacks an eigenvector of its own.

# %%
show("explicit_undamped_limit")

# %% [markdown]
# <details><summary>Derive: both Eulers on the spring</summary>
#
# *Explicit Euler*: $A = \begin{pmatrix}1 & h\\ -\omega^2h & 1\end{pmatrix}$, eigenvalues $1 \pm i\omega h$, so
# $\lvert\lambda\rvert^2 = 1 + (\omega h)^2 > 1$ for **every** $h$. There is no stable step.
#
# *Semi-implicit Euler*: $A = \begin{pmatrix}1-\omega^2h^2 & h\\ -\omega^2h & 1\end{pmatrix}$ has determinant 1. That
# makes the *product* of the eigenvalues one, which they satisfy as a pair on the unit circle, or as a real pair
# $\lambda, 1/\lambda$. Which of the two is decided by the trace: the circle needs $\lvert 2-\omega^2h^2\rvert < 2$,
# that is $\omega h < 2$. At equality both eigenvalues are $-1$ with a single eigenvector, and the state grows
# linearly.
#
# </details>

# %%
show("semi_implicit_unconditional")

# %% [markdown]
# A contact is often modelled as a stiff spring that pushes back in proportion to the depth: a **penalty** contact. So
# the hardest contact sets the step of the whole scene. Where a scene can't afford that step everywhere, one takes
# several short physics steps, **substeps**, for each step of the controller.
#
# <div class="alert alert-block alert-warning">
#
# **Key insight.** There is no good step in milliseconds. For semi-implicit Euler there is $h < 2/\omega_{\max}$: the
# fastest oscillation in the model decides, and a contact that opens and closes needs a smaller step.
#
# </div>

# %%
more_claims(
    "explicit_eigenvalues",
    "quoted_modulus",
    "growing_determinant_has_a_limit",
    "determinant_one_is_stable",
    "stable_at_the_limit",
    "explicit_damped_limit",
    "limit_scales_with_root",
    "contact_stable_at_1_khz",
    "contact_rate_by_stability",
    "penalty_listing_limits",
)

# %% [markdown]
# ### Stepping an orientation

# %%
show("renormalising_repairs")

# %% [markdown]
# **An orientation is updated by multiplication**, $q \leftarrow q\,\exp(h\,\omega)$. Here $q = (w, x, y, z)$ takes
# body coordinates to world coordinates and $\omega$ is in the body frame; that is why exp stands on
# the right. Adding $h\,\dot q$ leaves the unit sphere, and in a low-order step scaling back repairs the length, not
# the angle. At fourth order it does no harm; section 7 measures both.

# %%
more_claims(
    "quaternion_norm_keeps_itself",
    "added_quaternion_adds_energy",
    "renormalised_rk4_order",
)

# %% [markdown]
# ### Four more, and what a step costs
#
# Write $a = a(q, v)$ for the acceleration, and read $q \oplus u$ as "move from $q$ by $u$": plain addition for
# positions, $q\,\exp(u)$ for orientations. **Velocity Verlet**, which is the **leapfrog** method with both quantities
# at the same times, averages old and new acceleration. **RK4** averages four slopes.
#
# <table>
# <tr><th>method</th> <th>one step</th> <th>order</th> <th>evaluations</th> <th>keeps area</th> <th>limit,
# undamped</th></tr>
# <tr><td>explicit Euler</td> <td>$q' = q\oplus hv,\;\; v' = v + ha$</td> <td>1</td> <td>1</td> <td>no</td> <td>none:
# always unstable</td></tr>
# <tr><td>semi-implicit Euler</td> <td>$v' = v + ha,\;\; q' = q\oplus hv'$</td> <td>1</td> <td>1</td> <td>yes</td>
# <td>$\omega h < 2$</td></tr>
# <tr><td>velocity Verlet</td> <td>$q' = q\oplus(hv + \tfrac{h^2}{2}a),\;\; v' = v+\tfrac h2(a+a')$</td> <td>2</td>
# <td>2; 1 if forces depend on $q$ alone and the last is kept</td> <td>yes</td> <td>$\omega h < 2$</td></tr>
# <tr><td>explicit midpoint</td> <td>full step with the derivative half way</td> <td>2</td> <td>2</td> <td>no</td>
# <td>none: always unstable</td></tr>
# <tr><td>implicit midpoint</td> <td>the same, half way solved for</td> <td>2</td> <td>4 and more</td> <td>yes</td>
# <td>none on a spring</td></tr>
# <tr><td>RK4 (on rotations: Munthe-Kaas)</td> <td>four slopes, weights $\tfrac16,\tfrac13,\tfrac13,\tfrac16$</td>
# <td>4</td> <td>4</td> <td>no</td> <td>$\omega h \le 2\sqrt2$</td></tr>
# </table>
#
# *Order* $p$ means that halving the step divides the error by $2^p$. Where $a$ depends on the velocity too, Verlet
# takes $a' = a(q', v + ha)$. A seventh function, `rk4_renormalised`, adds the quaternion's rate and rescales; it is
# there to be compared.

# %%
show("semi_implicit_is_verlet")

# %%
more_claims(
    "verlet_limit",
    "explicit_midpoint_limit",
    "rk4_limit",
    "implicit_midpoint_limit",
    "evaluations_per_step",
    "semi_implicit_stability_per_cost",
)

# %% [markdown]
# ### What "symplectic" promises
#
# **Symplectic** (semi-implicit Euler is also called symplectic Euler) means, with one degree of freedom, that a patch
# of starting states keeps its area in the plane of position and momentum, for forces that depend on position alone and
# constant masses.

# %%
show("area_preserved")

# %%
show("symplectic_conserves_energy")

# %% [markdown]
# What does follow, for a smooth system and a fixed step well inside the limit: the energy error stays bounded for times
# exponential in $1/h$. It does not follow that energy is conserved, that the phase is right, that the method is stable
# at every step, or that anything survives friction or a changing step.
#
# <details><summary>Derive: why the energy stays near, and where the promise ends</summary>
#
# With more degrees of freedom symplectic asks for more than a volume that is kept: the areas of a patch's shadows on
# the planes $(q_i, p_i)$ keep their sum. The method then follows a *nearby* energy function up to an exponentially
# small error (on the oscillator exactly).
#
# In angles and rates, an arm's Coriolis terms and a body's $\omega\times(I\omega)$ depend on the velocity: there *no*
# method of the table is symplectic, and semi-implicit Euler's energy drifts steadily on a double pendulum (claim
# `semi_implicit_arm_energy`) and on a tumble. Symplectic methods for those work with momenta (splitting, RATTLE,
# discrete Moser-Veselov).
#
# </details>

# %%
more_claims(
    "semi_implicit_energy_swing",
    "rk4_energy_factor",
    "symplectic_with_varying_step",
    "semi_implicit_arm_energy",
    "semi_implicit_keeps_area_always",
    "volume_kept_bounds_energy",
    "symplectic_removes_stiffness",
    "reason_for_symplectic",
)

# %% [markdown]
# ### A ball that bounces, and its energy

# %%
show("semi_implicit_dissipates")

# %% [markdown]
# On a spring the energy swings within a fixed band and goes nowhere. A falling ball is different. For a constant
# force the six integrators are only three: the position gains $hv + c\,h^2a$ with $c = 0$ (explicit Euler), $c = 1$
# (semi-implicit Euler) or $c = \tfrac12$ (all others, and exact). Per step of free fall the energy changes by
# $mg^2h^2(\tfrac12 - c)$. So explicit Euler gains $\tfrac12 mg^2h^2$ and semi-implicit Euler *loses* as much: what you
# saw on the first screen.
#
# Then comes the floor. **Restitution** $e$ is the speed after an impact over the speed before. The *worked example* of
# the cards below is a ball of 1 kg that falls 5 m and bounces with $e = 1$, in steps of 10 ms.

# %%
show("bounce_gives_the_loss_back")

# %% [markdown]
# The usual rule for a bounce is "found below the floor: put it on the floor and turn the velocity round". Is at least
# that rule harmless when $e = 1$?

# %%
show("elastic_bounce_rule")

# %% [markdown]
# After ten bounces a table of energies is more about the bounce rule than about the integrator. RK4, which is exact in
# flight, is as wrong as the rule. Only an impact that is found *inside* the step mends it.
#
# <details><summary>Derive: the loss of a flight, and the gain of a bounce</summary>
#
# The energy error has the same sign at every step, rising or falling. Over a flight it is exactly $\tfrac12 mgh$ times
# the change of velocity. A bounce turns the velocity round and gives nothing of it back: the next flight loses as much
# again. The rule at the floor lifts the ball by the depth $d$, which adds $mgd$, while its speed stays what it was at
# depth $d$.
#
# </details>

# %%
more_claims(
    "free_fall_energy_error",
    "semi_implicit_free_fall",
    "worked_step_1_semi_implicit",
    "worked_step_100",
    "worked_step_500",
    "worked_ten_bounces_explicit",
    "worked_ten_bounces_semi_implicit",
    "worked_ten_bounces_rk4",
    "worked_table_belongs_to_the_method",
    "semi_implicit_bouncing_decays",
    "bounce_rule_takes_energy",
    "listing_box_tumbles",
    "listing_energy_decay",
    "explicit_in_the_listing_grows",
)

# %% [markdown]
# ## 3 · Design: the loop around the equations
#
# A simulator does six things, here at four different rates. The physics step is fixed; everything else happens on
# ticks of it. The order within a tick matters: sensors are read from the state that exists, the controller answers,
# forces are gathered, the state moves, contacts are found, and now and then a picture is drawn.

# %%
from course.rigid_body.loop import FixedStepLoop, Phases, flow_diagram, trace_table

spring = problems.oscillator().system


def integrate(state, force, dt):
    return rigid_body.semi_implicit_euler(*state, spring.acceleration, dt, spring.params)


loop = FixedStepLoop((spring.q0, spring.v0), Phases(integrate=integrate), record=True)
print(flow_diagram(loop))

# %%
show("steps_per_picture")

# %% [markdown]
# The first steps of that loop, and its second picture. `age` is the time since the state that the event works with,
# for `apply forces` since the measurement behind the command: 1 ms in every second step, because the command is held.
# The picture at 16.667 ms is one step old.

# %%
_ = loop.advance(0.018)
rows = trace_table(loop.trace).splitlines()
figures("\n".join(rows), rows[0], "1.000", "16.667", summary="All 18 ms, event by event")

# %% [markdown]
# Three details separate a loop that works from one that nearly does:
#
# * **An accumulator.** Real time arrives in uneven pieces. Add each piece to an account and take whole physics steps
#   out of it; what is left tells how far between two states the picture lies. The physics then never sees the clock:
#   the same inputs give the same motion, bit for bit.
# * **Interpolation.** Drawing the latest state makes the motion judder by up to one step. Interpolating between the
#   last two costs one step of delay.
# * **Counting in integers.** Adding 0.001 a few million times is not the same as multiplying:

# %%
from course.rigid_body.loop import float_clock_error

print(
    f"error of a summed clock after one hour at 1 kHz: {float_clock_error(0.001, 3_600_000):.2e} s"
)

# %% [markdown]
# When the machine is slower than real time, something has to give: the loop takes at most so many steps at once and
# *reports* the time it dropped. A loop that silently tries to catch up takes longer for each frame and never does.

# %%
show("step_sweet_spot")

# %% [markdown]
# So the highest frequency in the model sets the step, and accuracy usually asks for much less: read it off the charts
# of section 6.
#
# This course measures itself against the libraries that professionals use. For this chapter that is **MuJoCo**
# (Multi-Joint dynamics with Contact; Todorov, Erez and Tassa, 2012), an open physics engine that much of robot
# learning runs on. It orders the same six things in another way:

# %%
show("collisions_after_integration")

# %%
more_claims(
    "cameras_in_every_step",
    "clock_by_adding_dt",
    "deformables_need_a_tenth",
    "tenth_of_the_step",
)

# %% [markdown]
# ## 4 · Code: the reference functions
#
# Each integrator is one function over a *system*: positions on a manifold, velocities, and a function for the
# acceleration. If there is one position more than velocities, the last four are a quaternion (MuJoCo's convention).
# This is all it takes to move on both kinds of space:

# %%
source(rigid_body.retract, rigid_body.semi_implicit_euler)

# %%
show("rotation_stages_add")

# %% [markdown]
# RK4 therefore needs one more idea on rotations. Its four velocities belong to *different* orientations, and turns do
# not commute. Two brackets (cross products of the stages' velocities) make up for it, and one exponential ends the
# step (Munthe-Kaas and Owren 1999). In a vector space the brackets are zero and the method is the one you know.

# %%
source(rigid_body.rk4)

# %% [markdown]
# The judge is a problem with a closed form. A free body with three different moments turns by Jacobi's elliptic
# functions, its angle about the fixed $L$ by an elliptic integral of the third kind. Twenty seconds at 1 ms:

# %%
tumbling = problems.tumble()
for name in ("semi_implicit_euler", "implicit_midpoint", "rk4", "rk4_renormalised"):
    run = rigid_body.simulate(tumbling.system, name, 1e-3, 20_000, every=20_000)
    ends = [(run.q[i], run.v[i], tumbling.system.params) for i in (0, -1)]
    energy = [problems.tumble_energy(*end) for end in ends]
    momentum = [problems.angular_momentum(*end) for end in ends]
    drift = np.linalg.norm(momentum[1] - momentum[0]) / np.linalg.norm(momentum[0])
    numbers = (tumbling.error(run.q[-1]), abs(energy[1] / energy[0] - 1), drift)
    # Below 1e-11 one would read the rounding of this machine.
    error, by_energy, by_momentum = (f"{x:.0e}" if x > 1e-11 else "<1e-11" for x in numbers)
    print(
        f"{name:<20} off by {error:>6} rad; drift of energy {by_energy:>6}, of L {by_momentum:>6}"
    )

# %% [markdown]
# ### A box that really tumbles

# %%
predict("box_at_rest")

# %% [markdown]
# The planar body has extent: a force at a point makes a torque, corners hit the ground at a time that is found
# *inside* the step, and each impact is solved with restitution and **Coulomb friction**: a tangential force of at most
# $\mu$ times the normal one, against the sliding. Restitution here is energetic (Stronge 1990): the ratio of work
# given back to work taken is $e^2$. With Newton's velocity ratio and friction an impact can *create* energy (Kane's
# puzzle, 1984); this one can't.

# %%
box = planar.PlanarBody(restitution=0.7, friction=0.5)
box.state[:] = (0.0, 1.0, 0.4, 0.5, 0.0, 1.0)
path, total = [box.state.copy()], [box.energy()[2]]
for _ in range(1500):
    box.step(2e-3, integrator="rk4")
    path.append(box.state.copy())
    total.append(box.energy()[2])
path = np.array(path)
outline = np.array([[-0.15, 0.15, 0.15, -0.15, -0.15], [-0.1, -0.1, 0.1, 0.1, -0.1]])
figure_, axes = plt.subplots(1, 2, figsize=(11, 3.2), layout="constrained")
for i in range(0, 1500, 25):
    x, y, angle = path[i, :3]
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ outline
    _ = axes[0].plot(x + turned[0], y + turned[1], color=plt.cm.viridis(i / 1500), linewidth=0.8)
_ = axes[0].axhline(0, color="0.3")
_ = axes[0].set(
    aspect="equal", xlabel="x [m]", ylabel="y [m]", title="every 50 ms for 3 s, dark to bright"
)
_ = axes[1].plot(np.arange(len(total)) * 2e-3, total)
_ = axes[1].set(xlabel="time [s]", ylabel="total energy [J]", title="energy falls at impacts only")
plt.show()
print(f"impacts: {box.impacts}, steps not resolved: {box.unresolved}")
print(f"at rest after 3 s: {bool(np.all(path[-1][3:] == 0.0))}, height {path[-1][1]:.6f} m")

# %% [markdown]
# ## 5 · The simulation in full
#
# Every control of the bouncing box. Move gravity, restitution, friction and the step; choose the integrator; drag the
# box; watch the three energies. *Steps not resolved* counts steps in which more impacts fell due than are
# followed in one. Each preset shows one failure. Before you choose one, say what will happen:
#
# 1. Which integrators make the *same* motion in flight, and why?
# 2. RK4, but impacts noticed at the end of the step: does the energy stay?
# 3. The rest speed at zero: what does the box do when it should lie still?
# 4. Steps of 50 ms: how deep in the floor is the box found?

# %%
simulation("bouncing_box")

# %% [markdown]
# ## 6 · Speed against accuracy

# %%
show("rk4_costs_four_times")

# %% [markdown]
# Nobody wants a step; one wants an answer within a tolerance. A **work-precision** diagram puts the error on one axis
# and the cost on the other, for every method and many step sizes. The best method for your tolerance is the one
# furthest to the left at its height. Methods run interleaved in one process, medians of several rounds; a method that
# failed is a mark at the top, not a gap.

# %%
show("orders_of_accuracy")

# %%
from course.simulations.trade_off import TradeOff

result = accuracy.work_precision("double_pendulum", repeats=3, best=True)
for curve in result.curves:
    print(f"{curve.name:<22} observed order {result.observed_order(curve.name):.1f}")
TradeOff(result)

# %%
show("mujoco_euler_is_semi_implicit")

# %% [markdown]
# Drag the tolerance, or use the arrow keys on it: the circle goes to the cheapest run within it, and the sentence says
# what that costs. The buttons switch on the other methods. MuJoCo's integrators are curves in the same picture. In
# plain coordinates they are our methods: its `Euler` lies on semi-implicit Euler, its `RK4` on RK4, in error to several
# digits. Its `implicitfast` and `discrete` are of first order. What differs is the time per step, because MuJoCo's is a
# step of a general engine.
#
# Put a step function of your own on it. It runs as plain Python, so compare it in the left panel:


# %%
def my_step(q, v, acceleration, dt, params):
    """Change me: a step of your own. This one is semi-implicit Euler."""
    v = v + dt * acceleration(q, v, params)
    return rigid_body.retract(q, dt * v), v


mine = result.with_method(accuracy.your_method("double_pendulum", my_step))
_ = accuracy.draw(mine)
plt.show()
print(f"observed order of yours: {mine.observed_order('yours'):.1f}")

# %%
predict("method_for_a_tumble")

# %% [markdown]
# The same chart for the free tumble, with a tolerance of 1 mrad after 20 s. The two RK4s differ only in how they
# handle the quaternion. (On rotations MuJoCo's `RK4` is another fourth-order method, with a slightly smaller constant.)
#
# ![Error against cost on the free tumble](../docs/charts/work_precision_tumble.png)
#
# For the bouncing box there are two first-order errors, the flight of semi-implicit Euler and impacts placed at the
# end of a step. Each cure helps only together with the other. (Without either one is nearer here than with one of them:
# the two errors have opposite signs and partly cancel, by luck.)
#
# ![Error against cost on the bouncing box](../docs/charts/work_precision_box.png)

# %% jupyter={"source_hidden": true}
figures(
    read("table_at_one_millisecond"),
    "problem",
    "tumble      semi_implicit_euler",
    "tumble      rk4 ",
    "tumble      MuJoCo RK4",
    "box drop    exact flight, impact times",
    "box drop    semi-implicit, end of step",
    "box drop    MuJoCo Euler (impulse)",
    summary="All methods and problems at a step of 1 ms",
)

# %% [markdown]
# <details><summary>Where MuJoCo and the course differ, and why</summary>
#
# 1. `implicitfast` and `discrete` treat the gyroscopic torque of a free body with nothing jointed to it implicitly:
#    its energy can't grow, but a tumble is damped, and the attitude is still of first order, about as far off as with
#    `Euler`.
# 2. MuJoCo has no coefficient of restitution, but two ways to one. "impulse" in the table: a contact damper of
#    $(1+e)/h$ and no stiffness turns $v$ into $-ev$ in one step (Euler and the two implicit ones; nothing pushes a
#    sunken body out). "spring": a spring and damper, for every integrator, which takes time and depth and must be
#    tuned; compare rows of the same kind only.
# 3. No integrator of MuJoCo cuts the step at the impact; its `speculative` flag (off by default) finds the time of
#    impact so that no wall is missed, not to place the impact. The error at a contact is of first order, RK4 or not.
#
# </details>

# %%
more_claims(
    "mujoco_defaults",
    "mujoco_stable_by_euler",
    "mujoco_euler_damping_explicit",
    "mujoco_any_stiffness",
    "mujoco_discrete_has_a_limit",
    "mujoco_rk4_on_rotations",
    "mujoco_free_spin_energy",
    "mujoco_implicitfast_gyroscopic",
)

# %% [markdown]
# ### Many bodies at once
#
# Training needs thousands of copies. (Most runs on GPUs today, in MuJoCo Warp, MJX or Isaac, not measured here.) The
# same source, compiled for whole batches, beside `mujoco.batch`, one core each (sim s / s: simulated seconds in a
# second):
#
# ![Bodies per second against the number of bodies](../docs/charts/throughput.png)

# %% jupyter={"source_hidden": true}
figures(
    read("throughput"),
    "who  ",
    "course                            1000 ",
    "mujoco.batch                      1000 ",
    summary="All batches, boxes and free bodies",
)

# %% [markdown]
# Read this with care: it compares *a planar box* with *a general engine that was asked about a planar box*. The gain is
# what you get for modelling no more than the scene needs. It is lost once a second body touches the first.
#
# <details><summary>How it was measured, and the free bodies</summary>
#
# The accuracy was judged without friction through the first impacts, the rate measured with friction over 1 s. The
# second table is free bodies: for one body the two are about equal, because one call from Python costs as much as the
# run; the gain comes with the batch.
#
# </details>
#
# ### The smallest model that answers the question

# %%
predict("what_to_leave_out")

# %% [markdown]
# Speed begins before the integrator: with what you leave out. A **scene** states its question, the tolerance the
# answer needs, and what is left out together with the error of leaving it out, measured against a model that has it.

# %% jupyter={"source_hidden": true}
figures(
    read("scene_bouncing_box"),
    "How high",
    "tolerance",
    "rotation",
    "deformation",
    "the scene",
    "answer",
    summary="All effects, in and out",
)

# %% [markdown]
# ### What to pick
#
# * *Contact-rich robots at 1 kHz*: the semi-implicit family (in MuJoCo `implicitfast`, which also takes the damping of
#   actuators and tendons implicitly). The contacts set the step, and the contact error is of first order anyway.
# * *Smooth motion over up to some hundred periods* (free flight, flexible joints): RK4, the cheapest at its tolerance
#   on most of the smooth problems here (the pendulum's chart, at 1 mrad, picks Verlet).
# * *Stiff springs that you don't need to resolve*: an implicit method that damps (implicit Euler, which is what
#   MuJoCo's `discrete` does to a spring). Implicit midpoint stays stable too, but lets the unresolved spring ring.
# * *Long runs whose statistics matter*: a symplectic method with a fixed step.
#
# ## 7 · Debug: where it fails
#
# ### The limit, measured

# %%
predict("damping_and_the_limit")

# %% [markdown]
# Now with a damper: $\ddot x = -2\zeta\omega\dot x - \omega^2 x$, where $\zeta = 1$ is critical damping. Bisection on
# the step, until the growth per step is one; `worst` is the largest relative distance from the theory. MuJoCo's own
# integrators are measured in the same way, as black boxes; `eulerdamp` is its switch for implicit joint damping.

# %% jupyter={"source_hidden": true}
figures(
    read("stability_limits"),
    "limit",
    "explicit_euler",
    "semi_implicit_euler",
    "MuJoCo Euler  ",
    cut="worst",
    summary="All integrators, and how far they are from the theory",
)

# %% [markdown]
# ![Stability maps](../docs/charts/stability_maps.png)
#
# Semi-implicit Euler with explicit damping has a limit that *shrinks* with damping. MuJoCo's `Euler` takes joint
# damping implicitly, and its limit *grows* with damping. No integrator but `discrete` takes the spring itself
# implicitly:

# %%
show("mujoco_rk4")

# %% [markdown]
# ![The stiff spring in MuJoCo](../docs/charts/mujoco_stiff_spring.png)

# %%
more_claims("halving_dt_finds_the_culprit", "arm_drift_is_numerical")

# %% [markdown]
# ### Energy over a million steps
#
# ![Energy error over a million steps](../docs/charts/long_run_energy.png)

# %% jupyter={"source_hidden": true}
figures(
    read("long_run_energy").replace("largest relative energy error: ", ""),
    "explicit_euler",
    "semi_implicit_euler",
    "rk4",
    summary="All methods: largest relative energy error",
)

# %% [markdown]
# Bounded is what "symplectic" buys. Here is where it is not enough. Alternate two steps that are each below the limit
# ($\omega h$ = 1.7 and 1.2): unstable. Far below the limit it takes a pattern in tune with the motion (five steps of
# 0.3, then sixteen of 0.1), and the amplitude still grows with every cycle. A product of area-preserving maps preserves
# area, and can stretch one direction without end:
#
# ![Alternating steps](../docs/charts/symplectic_not_enough.png)

# %% jupyter={"source_hidden": true}
figures(
    read("symplectic_not_enough"), summary="Growth per cycle, measured and in theory; phase errors"
)

# %% [markdown]
# ### Impacts

# %%
show("order_survives_bounces")

# %% [markdown]
# A pendulum that hits an elastic wall at its lowest point has a closed form (it is the mirrored free pendulum), so the
# order can be measured:
#
# ![Order with and without events](../docs/charts/events_order.png)

# %%
print(read("events_order"))

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** An impact that the step does not resolve makes every method first order. Then the cheap one wins.
#
# </div>

# %%
more_claims("mujoco_rk4_contact_order", "mujoco_contact_stiffness_limit")

# %% [markdown]
# ### Through the wall

# %%
show("tunnelling_thickness")

# %%
simulation("tunnelling")

# %% [markdown]
# **Tunnelling**: the collision is never looked at, because the body is in front of the wall at one step and behind it
# at the next. With $D$ for both thicknesses together, body and wall, one check per step misses with probability
# $1 - D/(vh)$. The cure is **continuous collision detection**: sweep the motion between two steps, and find the time
# of impact.
#
# MuJoCo's default contact adds a limit that no smaller step removes: it is so soft that a fast ball's centre gets past
# the middle of the wall, $d/2 + r$ from the first touch (half the wall, and the radius):
#
# ![Tunnelling](../docs/charts/tunnelling.png)

# %% jupyter={"source_hidden": true}
figures(
    read("tunnelling").replace(" (theory)", ""),
    "checked once",
    "MuJoCo, one-step",
    "MuJoCo, default",
    summary="All speeds and steps",
)

# %%
more_claims(
    "contact_seen_is_contact_stopped",
    "continuous_detection_or_smaller_step",
    "penetration_limit_catches",
    "mujoco_ccd_is_continuous",
)

# %% [markdown]
# ### Never at rest

# %%
predict("impacts_at_rest")

# %% [markdown]
# A ball's bounces get shorter by the factor $e$ each time, infinitely many in a finite time. A box that should lie
# still "bounces" at every step: gravity gives it the speed $gh$, and the impact turns it round. A rest speed, below
# which an impact is the last, ends that where impacts are found within the step, and at the end of a step only if it
# is above $gh$:
#
# ![Chatter](../docs/charts/chatter.png)

# %% jupyter={"source_hidden": true}
figures(
    read("chatter"),
    "semi_implicit_euler, in the step, rest speed 0.01",
    "semi_implicit_euler, end of step, rest speed 0  ",
    "semi_implicit_euler, end of step, rest speed 0.01",
    "MuJoCo Euler, impulse",
    "MuJoCo Euler, spring",
    summary="All methods and contacts",
)

# %% [markdown]
# ### Orientation over a million steps
#
# "Added" means that $h\dot q$ is added to the quaternion; its length then grows, and the angle lags whether or not it
# is rescaled:
#
# ![Quaternion drift](../docs/charts/quaternion_drift.png)

# %% jupyter={"source_hidden": true}
figures(
    read("quaternion_drift").replace("after 1e6 steps: ", ""),
    "added and renormalised, 10 mrad",
    "exponential map, 10 mrad",
    "tumble over 20 s, rk4 ",
    "tumble over 20 s, rk4_r",
    summary="All ways to step",
)

# %% [markdown]
# ### Debugging table
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The simulation explodes.* Compare $h$ with $2/\omega_{\max}$, where $\omega_{\max}^2$ is the
# largest eigenvalue of $Kx = \omega^2Mx$. Halving the step tells you whether it is the step.
#
# <details><summary>What people get wrong there</summary>
#
# $\sqrt{k/m}$ of the stiffest single spring is only a lower bound: coupling can multiply it (two fingers on one part, a
# chain of masses). And the limit is for springs that stay in touch; an elastic contact gains energy below it.
#
# An explicit damper lowers the limit of semi-implicit Euler to $\omega h < 2(\sqrt{1+\zeta^2}-\zeta)$; testing $\omega
# h < 2$ and $hc/m < 2$ one by one, as one often reads, passes $\zeta = 1$ at $\omega h = 0.9$, beyond the limit of
# $2(\sqrt2-1)$. On an undamped spring a smaller step cures nothing if the integrator is explicit Euler, which needs
# damping to have a limit at all: $\omega h < 2\zeta$ for $\zeta \le 1$.
#
# </details>
#
# </div>
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *Objects pass through each other.* Compare the distance travelled per step, $vh$, of one against
# the other, with the *sum* of both thicknesses. If it is larger, the collision may never be looked at, and no
# integrator helps: sweep the motion, or find the impact time (MuJoCo: `speculative`). From half of it on, it may first
# be seen past the middle: the same cure. If it is much smaller, the contact was too soft: stiffen it.
#
# </div>
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *Energy grows and nothing pushes.* Log kinetic and potential energy separately, without contacts
# first. Growth by the factor $1+(\omega h)^2$ per step is explicit Euler; a jump at every impact is the bounce rule;
# slow growth of a tumbling body is an explicit gyroscopic term.
#
# </div>

# %%
predict("perfect_energy_wrong_momentum")

# %% [markdown]
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>positions go to infinity within a few steps</td> <td>$h$ beyond the limit of the stiffest spring</td>
# <td>$\omega_{\max}h$ against the table above</td> <td>smaller step, implicit method, softer contact</td></tr>
# <tr><td>amplitude grows slowly at <em>every</em> step size</td> <td>explicit Euler or explicit midpoint, on an
# oscillation that nothing damps</td>
# <td>energy ratio per step: $1+(\omega h)^2$, or $1+(\omega h)^4/4$</td> <td>Euler: swap the two lines; midpoint:
# Verlet or RK4</td></tr>
# <tr><td>energy fine in flight, wrong after bounces</td> <td>bounce rule at the end of the step</td> <td>drop with
# $e=1$, compare apex heights</td> <td>resolve the impact time</td></tr>
# <tr><td>box jitters on the floor for ever</td> <td>each step's $gh$ is turned round by the impact</td> <td>count
# impacts per second</td> <td>a rest speed above $gh$, or contact at velocity level</td></tr>
# <tr><td>fast object passes a thin wall</td> <td>$vh$ larger than both thicknesses together, or a contact that is too
# soft</td> <td>print $vh/D$; record the depth</td> <td>sweep the motion or find the impact time; stiffen the
# contact</td></tr>
# <tr><td>orientation drifts, matrix no longer orthogonal</td> <td>quaternion was added, not multiplied</td>
# <td>$\lvert q\rvert-1$ over time</td> <td>$q\exp(h\omega)$</td></tr>
# <tr><td>a jump of $2\pi$, or a controller that turns the long way</td> <td>$q$ compared with $-q$</td> <td>dot
# product of the two</td> <td>take the shorter of the two</td></tr>
# </table>

# %%
predict("drift_of_joints")

# %% [markdown]
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>energy and $\lvert q\rvert$ perfect, yet the angular momentum of a free body turns in space</td> <td>body
# rate multiplied on the world side, or the gyroscopic term with the wrong sign</td> <td>$L$ in the world over time;
# then a spin about one principal axis, from a tilted start, and three equal moments: both have no gyroscopic
# term</td> <td>$q\exp(h\omega)$ for body rates, $\exp(h\omega)\,q$ for world rates;
# $I\dot\omega=-\omega\times(I\omega)$</td></tr>
# <tr><td>satellite speeds up without torque</td> <td>gyroscopic term explicit at a large step</td> <td>kinetic energy
# over time</td> <td>RK4, implicit midpoint, smaller step</td></tr>
# <tr><td>joints creep with no command</td> <td>gravity on and no motor holds it; or friction that the engine
# models softly</td> <td>switch gravity off; halve $h$</td> <td>compensate gravity; harder friction</td></tr>
# </table>
#
# ## 8 · Exercises
#
# Each has a card with the task and three hints, a cell to change, and a check, which runs what your cell defines on
# cases drawn afresh, and says what is wrong and, where it recognises the mistake, why.
#
# Keep its result for more: `check(verlet_step).chart()` puts a right answer on a work-precision chart beside the worked
# answer and MuJoCo. `drills.notebook.solution("verlet")` shows the worked answer after a pass. The same exercises run
# in a terminal: `drills start verlet`, `drills check verlet`.

# %% [markdown]
# ### Integrators
#
# Section 2 has the formula; here it has to cost one evaluation, and to run backwards.

# %%
card("verlet")


# %%
def verlet_step(q, v, a, acceleration, dt):
    """Return one step of velocity Verlet.

    Args:
        q, v, a: positions [m], velocities [m/s] and acceleration at q [m/s^2], shape (n,) each.
        acceleration: function q -> acceleration, to be called once.
        dt: step [s].

    Returns:
        The new (q, v, a).
    """
    # Explicit Euler: change this into velocity Verlet.
    q_new = np.asarray(q) + dt * np.asarray(v)
    v_new = np.asarray(v) + dt * np.asarray(a)
    return q_new, v_new, acceleration(q_new)


# %%
check(verlet_step)

# %% [markdown]
# ### Orientation
#
# Exact for every angle, also for none.

# %%
card("orientation")


# %%
def update_orientation(q, omega, dt):
    """Return the orientation after turning for dt at a constant body rate.

    Args:
        q: unit quaternion (w, x, y, z), body to world, shape (4,).
        omega: angular velocity in the body frame, shape (3,) [rad/s].
        dt: step [s].

    Returns:
        Unit quaternion (w, x, y, z), shape (4,).
    """
    # It does not turn yet.
    return np.array(q, dtype=float)


# %%
check(update_orientation)

# %% [markdown]
# ### Impacts
#
# Sections 2 and 7 show what a bounce at the end of the step does. Do it right.

# %%
card("bounce")


# %%
def bounce_step(y, v, dt, restitution, gravity=9.81):
    """Return height and velocity of a bouncing point after dt.

    Args:
        y: height above the floor, not negative [m].
        v: velocity, upwards positive [m/s].
        dt: length of the step [s].
        restitution: speed after an impact over speed before, 0 to 1.
        gravity: downwards, positive [m/s^2].

    Returns:
        (y, v) at the end of the step.
    """
    # Free flight: the floor is missing.
    return y + v * dt - 0.5 * gravity * dt**2, v - gravity * dt


# %%
check(bounce_step)

# %% [markdown]
# ### The step
#
# The debugging tip of section 7, as a function.

# %%
card("stable_step")


# %%
def largest_stable_step(stiffness, mass):
    """Return the longest step at which semi-implicit Euler is stable on M x'' = -K x.

    Args:
        stiffness: K, shape (n, n) [N/m].
        mass: M, shape (n, n) [kg].

    Returns:
        The step [s].
    """
    # A common default, which knows nothing of the model.
    return 0.001 * np.ones_like(np.asarray(mass, dtype=float))[0, 0]


# %%
check(largest_stable_step)

# %% [markdown]
# ### Evidence
#
# What to do when there is no closed form to compare with. Three runs with halved steps give the order, and
# **Richardson extrapolation** gives the result that they are heading for.

# %%
card("observed_order")


# %%
def observed_order(coarse, medium, fine, ratio=2.0):
    """Order of accuracy from three runs, and the result that they are heading for.

    Args:
        coarse, medium, fine: results with the steps r^2 h, r h and h, shape (n,) each [m].
        ratio: r, above 1.

    Returns:
        The order, and the result extrapolated to step zero, shape (n,) [m].
    """
    # Neither is right yet.
    return 1.0, np.array(fine, dtype=float)


# %%
check(observed_order)

# %% [markdown]
# ### Silent-bug hunt
#
# Nothing crashes, the pictures are plausible, one thing is wrong. A first one, to see what such a bug looks like:
# this line updates an orientation from a body rate.
#
# ```python
# q = quaternion.product(quaternion.exp(dt * omega_body), q)
# ```
#
# The rate stands on the wrong side. The length of $q$ and the kinetic energy cannot tell, because neither knows about
# the order of the factors. What can tell is the angular momentum of a free body, as a vector in the world.

# %%
inertia, dt = np.array([1.0, 2.0, 2.5]), 1e-3
for side in ("right", "left"):
    q, omega = quaternion.exp(np.array([0.4, -0.3, 0.8])), np.array([0.5, 2.0, 1.0])
    momentum = quaternion.rotate(q, inertia * omega)
    energy = inertia @ omega**2
    for _ in range(2000):
        half = omega - 0.5 * dt * np.cross(omega, inertia * omega) / inertia
        turn = quaternion.exp(dt * half)
        q = quaternion.product(q, turn) if side == "right" else quaternion.product(turn, q)
        omega = omega - dt * np.cross(half, inertia * half) / inertia
    moved = quaternion.rotate(q, inertia * omega) - momentum
    print(
        f"rate on the {side:<5}: length of q kept {abs(np.linalg.norm(q) - 1) < 1e-12}, energy off "
        f"by {abs(inertia @ omega**2 / energy - 1):.1g}, L moved by "
        f"{np.linalg.norm(moved) / np.linalg.norm(momentum):.1g} of itself"
    )

# %% [markdown]
# Now yours. The debugging table has its symptom, with two causes; the experiment that tells them apart is in the same
# row.

# %%
card("tumble")


# %%
def tumble(q, omega, inertia, dt, steps):
    """Return a body that turns freely, integrated with RK4.

    Args:
        q: orientation, unit quaternion (w, x, y, z), body to world, shape (4,).
        omega: angular velocity in the body frame, shape (3,) [rad/s].
        inertia: principal moments, shape (3,) [kg m^2].
        dt: step [s].
        steps: how many.

    Returns:
        (q, omega) at the end.
    """
    inertia = np.asarray(inertia, dtype=float)

    def rates(q, omega):
        w, x, y, z = q
        i, j, k = omega
        q_rate = 0.5 * np.array(
            [
                -x * i - y * j - z * k,
                w * i + y * k - z * j,
                w * j + z * i - x * k,
                w * k + x * j - y * i,
            ]
        )
        omega_rate = np.cross(omega, inertia * omega) / inertia
        return q_rate, omega_rate

    q, omega = np.array(q, dtype=float), np.array(omega, dtype=float)
    for _ in range(steps):
        q1, w1 = rates(q, omega)
        q2, w2 = rates(q + 0.5 * dt * q1, omega + 0.5 * dt * w1)
        q3, w3 = rates(q + 0.5 * dt * q2, omega + 0.5 * dt * w2)
        q4, w4 = rates(q + dt * q3, omega + dt * w3)
        q = q + dt / 6.0 * (q1 + 2.0 * q2 + 2.0 * q3 + q4)
        omega = omega + dt / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4)
        q = q / np.linalg.norm(q)
    return q, omega


# %%
check(tumble)

# %% [markdown]
# ### Formulas
#
# These are checked symbolically: any equivalent form is right, and a wrong one gets numbers at which it differs.
# <span class="kernel-only">Change the texts.</span>

# %%
answer("semi_implicit_limit", "2*sqrt(m/k)")

# %%
answer("semi_implicit_limit", "sqrt(m/k)")

# %% [markdown]
# Others to try: `explicit_energy_factor` (energy after one step over energy before, in `omega` and `h`), `rk4_limit`
# (largest stable step in terms of `omega`), `top_condition` (smallest stable spin in `I1`, `I3`, `m`, `g`, `l`).
#
# ## 9 · Frontier: differentiable simulation

# %%
predict("gradient_through_an_impact")

# %% [markdown]
# If every step is differentiable, so is the whole simulation: one backward pass gives the gradient of any loss with
# respect to all parameters, at the cost of a few forward runs, however many parameters there are (and of the memory
# for the whole trajectory, unless one checkpoints). That turns "which friction makes the simulator match the
# recording?" into descent.
#
# <table>
# <tr><th>engine</th> <th>runs on</th> <th>what it is known for</th></tr>
# <tr><td>Brax (Freeman et al. 2021)</td> <td>JAX</td> <td>rigid bodies on accelerators, for reinforcement
# learning</td></tr>
# <tr><td>DiffTaichi (Hu et al. 2020)</td> <td>Taichi</td> <td>gradients by source transformation of simulation
# kernels; time-of-impact correction</td></tr>
# <tr><td>Warp (Macklin 2022)</td> <td>GPU and CPU, kernels in Python</td> <td>reverse-mode gradients of simulation
# kernels</td></tr>
# <tr><td>MuJoCo MJX (2023)</td> <td>JAX</td> <td>MuJoCo's models and contact on accelerators</td></tr>
# <tr><td>Dojo (Howell et al. 2022)</td> <td>CPU, in Julia</td> <td>hard contact solved by an interior point method;
# smoothed gradients from its central path, by the implicit function theorem</td></tr>
# </table>

# %%
show("gradient_by_differences")

# %% [markdown]
# A small one runs here, with PyTorch's reverse mode on the equations of a block that is thrown, bounces, slides, and
# is pushed; the impact times are roots, so their derivatives are right. We record it with 1 mm of noise and ask for
# restitution, friction and mass.

# %%
from course.rigid_body.differentiable import (
    Setup,
    drop_gradients,
    information,
    naive_drop_gradients,
    record,
    recover,
)

scene = Setup((0.0, 0.5), (2.0, 0.0), push=((1.2, 1.5, 8.0),))
times = np.linspace(0.0, 2.0, 101)
truth = (0.6, 0.25, 1.3)
recorded = record(truth, scene, times, noise=1e-3, generator=np.random.default_rng(0))
print(recover(recorded, scene, guess=(0.4, 0.4, 1.0)))

# %%
predict("what_a_drop_tells")

# %% [markdown]
# **Recordings that say nothing.** A gradient can only find what the motion depends on. A drop without
# tilt and without spin carries no information about friction or mass, and a block that sticks tells only a *bound* on
# the friction, however long you record it and however good the optimiser is. The singular values of the Jacobian say so
# before you start:

# %%
for label, poor in (
    ("a drop without tilt or spin", Setup((0.0, 0.5))),
    ("a block that sticks under a push", Setup((0.0, 0.0), push=((0.2, 1.0, 2.0),))),
):
    print(f"--- {label}\n{information(truth, poor, times)}\n")

# %% [markdown]
# **Gradients through an impact.** As a function of time, the derivative of the height with respect to the drop height
# $H$ jumps at the impact, from 1 to $-e$ (and then rises by $(1+e)\,g/\sqrt{2gH}$ per second). A fixed-step simulation
# that looks for penetration at the end of each step and puts the body on the floor there gets the height right and
# this gradient *wrong*, at every step size.
#
# <details><summary>Why it comes out as zero</summary>
#
# After the impact its state depends on the drop height only through the number of steps before it, which is a whole
# number. The derivative of the impact time is lost, and what is left is whatever the position rule does: zero where the
# body is put on the floor (Hu et al. 2020 correct it by the time of impact; Suh et al. 2022 show what it does to policy
# gradients).
#
# </details>

# %%
exact = drop_gradients(1.0, 0.6, 0.8)
print("derivative of the height at 0.8 s with respect to the drop height of 1 m")
print(f"event resolved, by autograd: {exact.by_height:+.4f}   (height {exact.height:.4f} m)")
for dt in (1e-2, 1e-3):
    naive = naive_drop_gradients(1.0, 0.6, dt, 0.8)
    print(
        f"fixed steps of {1e3 * dt:4.0f} ms:       {naive.by_height:+.4f}   (height {naive.height:.4f} m)"
    )

# %%
more_claims(
    "gradient_search_is_linear",
    "every_recording_identifies",
    "smooth_gradients_by_draws",
    "mjx_is_differentiable",
)

# %% [markdown]
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** Asked about integrators, give three numbers for each: order, cost per step, stability limit; then
# say what your scene needs. "Semi-implicit Euler: first order, one evaluation, $\omega h<2$, no energy drift at a
# small fixed step while forces depend on position alone and masses are constant. RK4: fourth order, four evaluations,
# $\omega h<2.83$, loses $(\omega h)^6/72$ of the energy per step. With contacts at 1 kHz both make a first-order
# error at the impact, so I take the cheap one; for a satellite I take the other."
#
# </div>
#
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.

# %%
interview("rigid_body")

# %% [markdown]
# ### Checkpoint
#
# Three formulas that are not on this page; you can derive them from what is. The gate opens when all are right.

# %%
checkpoint(
    "rigid_body",
    verlet_frequency="",
    explicit_growth_per_second="",
    mujoco_damped_limit="",
)
