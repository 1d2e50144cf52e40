"""Contact of a planar box with the ground y = 0: when it hits, with what impulse, and how it rests.

The offset of a corner from the centre of mass is (rx, ry). The corner moves along the ground with
vt = vx - omega ry and away from it with vn = vy + omega rx. An impulse (pt, pn) at the corner
changes these by

    d vt = wtt pt + wnt pn,   d vn = wnt pt + wnn pn,
    wtt = 1/m + ry^2/I,   wnn = 1/m + rx^2/I,   wnt = -rx ry/I.

Everything here is written over single numbers, so that it runs inside the compiled loop of
`course.rigid_body.planar` and also as plain Python.
"""

import math

from numba.extending import register_jitable

QUARTER_TURN = 0.5 * math.pi
# A corner lower than this share of the half-diagonal touches the ground.
GAP_TOLERANCE = 1e-9
# The search for an impact ends this close to the ground (share of the half-diagonal).
IMPACT_TOLERANCE = 1e-13
# Slower than this a corner neither approaches nor leaves [m/s].
SPEED_TOLERANCE = 1e-12
# Two corners approach together, as one face, if their speeds differ by less than this share.
FACE_TOLERANCE = 1e-6
# Evaluations of one search for an impact, after which it reports how far it is safe to move.
SEARCH_LIMIT = 64

# What the search for an impact found.
CLEAR, HIT, UNFINISHED = 0, 1, 2


@register_jitable
def flight(position, velocity, acceleration, tau, coefficient):
    """Return a coordinate after constant acceleration for tau, as an integrator moves it."""
    return position + tau * velocity + coefficient * tau * tau * acceleration


@register_jitable
def lowest_corners(angle, width, height):
    """Return the lowest corner, and the other corner of the face nearest to the ground.

    Returns:
        (rx, ry, rx2, ry2): the two offsets from the centre of mass in world axes [m].
    """
    s = math.sin(angle)
    c = math.cos(angle)
    # Each half size enters with the sign that brings its corner lowest.
    a = -0.5 * width if s > 0.0 else 0.5 * width
    b = -0.5 * height if c > 0.0 else 0.5 * height
    rx = a * c - b * s
    ry = a * s + b * c
    # The second lowest corner differs in the half size that changes the height least.
    if width * abs(s) < height * abs(c):
        a = -a
    else:
        b = -b
    return rx, ry, a * c - b * s, a * s + b * c


@register_jitable
def impact(vt, vn, rx, ry, inverse_mass, inverse_inertia, restitution, friction):
    """Return the impulse of a hard impact with Coulomb friction and energetic restitution.

    The impact takes no time; its clock is the normal impulse p. While the corner slides one way
    its velocity is linear in p. It may stop sliding; then it sticks, or slides back where the
    cone does not allow sticking. Compression lasts until vn = 0 and takes the normal work W_c;
    restitution lasts until the normal work e^2 |W_c| is given back (Stronge, Rigid body
    collisions with friction, Proc. R. Soc. A 431, 1990). So the energy never grows for e <= 1,
    whatever the friction. In a central impact (rx = 0 or ry = 0 or no friction) vn' = -e vn.

    Args:
        vt: velocity of the corner along the ground [m/s].
        vn: velocity of the corner away from the ground, negative [m/s].
        rx: horizontal offset of the corner from the centre of mass [m].
        ry: vertical offset of the corner from the centre of mass [m].
        inverse_mass: 1/mass [1/kg].
        inverse_inertia: 1/inertia about the centre of mass [1/(kg m^2)].
        restitution: e in [0, 1].
        friction: Coulomb coefficient, not negative.

    Returns:
        (pt, pn): the impulse on the box [N s]; zero where vn >= 0.
    """
    if vn >= 0.0:
        return 0.0, 0.0
    # Inverse mass of the corner: normal, tangential and coupling entries of the Delassus matrix.
    wtt = inverse_mass + inverse_inertia * ry * ry
    wnn = inverse_mass + inverse_inertia * rx * rx
    wnt = -inverse_inertia * rx * ry
    # Second phase: stick if the cone allows it, else slide the way the normal impulse drives.
    if abs(wnt) <= friction * wtt:
        k2 = -wnt / wtt
    elif wnt > 0.0:
        k2 = -friction
    else:
        k2 = friction
    a2 = wnn + wnt * k2  # positive: the inverse mass is positive definite
    # First phase: slide as the corner comes, from p = 0 until vt = 0 at p = stop.
    k1 = k2
    a1 = a2
    stop = math.inf
    if vt != 0.0:
        k1 = -friction if vt > 0.0 else friction
        a1 = wnn + wnt * k1
        slowing = wnt + wtt * k1
        if vt * slowing < 0.0:
            stop = -vt / slowing
    # Compression stores work, restitution gives back e^2 of it (Stronge's energetic restitution).
    end_speed = -restitution * vn
    if a1 > 0.0 and -vn <= a1 * stop:  # compression ends while it still slides
        end = (end_speed - vn) / a1
        if end > stop:
            speed = vn + a1 * stop
            # Work still to be given back, over a1: (e vn)^2 - speed^2 = 2 a1 W.
            speed2 = speed * speed + (a2 / a1) * (end_speed * end_speed - speed * speed)
            end = stop + (math.sqrt(max(speed2, 0.0)) - speed) / a2
    else:  # it stops sliding first
        speed = vn + a1 * stop
        work2 = speed * speed / a2 - (vn + speed) * stop  # -2 W_c
        end = stop + (restitution * math.sqrt(a2 * work2) - speed) / a2
    sliding = min(end, stop)
    return k1 * sliding + k2 * (end - sliding), end


@register_jitable
def stopping_impulse(vt, vn, rx, ry, inverse_mass, inverse_inertia):
    """Return the impulse (pt, pn) that stops a corner, whatever the cone [N s]."""
    wtt = inverse_mass + inverse_inertia * ry * ry
    wnn = inverse_mass + inverse_inertia * rx * rx
    wnt = -inverse_inertia * rx * ry
    det = wnn * wtt - wnt * wnt
    return (wnt * vn - wnn * vt) / det, (wnt * vt - wtt * vn) / det


@register_jitable
def newton_impact(vt, vn, rx, ry, inverse_mass, inverse_inertia, restitution, friction):
    """Return the impulse by Newton's rule vn' = -e vn with friction, for comparison.

    It can create energy.

    The corner sticks (vt' = 0) if the cone allows it, else it slides as it came. With friction
    and an oblique impact the energy may grow (Kane, Stanford Mechanics Alumni Club Newsletter 6,
    1984; Keller, J. Appl. Mech. 53, 1986). Arguments and result as in `impact`.
    """
    if vn >= 0.0:
        return 0.0, 0.0
    dn = -(1.0 + restitution) * vn
    pt, pn = stopping_impulse(vt, -dn, rx, ry, inverse_mass, inverse_inertia)
    if abs(pt) <= friction * pn:  # it sticks
        return pt, pn
    # It slides on as it came; a corner without speed slides the way that sticking would have held.
    if vt > 0.0 or (vt == 0.0 and pt < 0.0):
        k = -friction
    else:
        k = friction
    a = inverse_mass + inverse_inertia * rx * (rx - ry * k)
    if a <= 0.0:  # jammed: sliding on cannot lift the corner, only sticking can
        return pt, pn
    return k * dn / a, dn / a


@register_jitable
def one_contact(vt, vn, rx, ry, inverse_mass, inverse_inertia, friction):
    """Return Coulomb impulse of one inelastic contact: vn' = 0, and stick or slide.

    The impulse that stops the corner decides: inside the cone the corner sticks, outside it
    slides against the side of the cone that was passed. One of the two always has a solution.

    Returns:
        (pt, pn), the impulse [N s].
    """
    if vn >= 0.0:
        return 0.0, 0.0
    pt, pn = stopping_impulse(vt, vn, rx, ry, inverse_mass, inverse_inertia)
    if abs(pt) <= friction * pn:  # it sticks
        return pt, pn
    if pn > 0.0:  # friction gives what it can of the impulse that would have stopped it
        k = -friction if pt < 0.0 else friction
    else:  # the ground would have to pull to stop it: friction acts against the sliding
        k = -friction if vt > 0.0 else friction
    pn = -vn / (inverse_mass + inverse_inertia * rx * (rx - ry * k))
    return k * pn, pn


@register_jitable
def two_contacts(vx, vy, omega, rx1, rx2, ry, inverse_mass, inverse_inertia, friction):
    """Return Coulomb contact, without restitution, of a face that lies on the ground.

    The two corners slide alike, so friction acts as one impulse bounded by both normal ones. The
    cases are tried in turn: apart, both corners stick, both slide, one carries, one jams.

    Returns:
        (vx, vy, omega, active): the new velocities, and which corners carry: 0 none, 1 the
        first, 2 the second, 3 both; -1 if no case fits (then everything is stopped).
    """
    # Apart: neither corner approaches.
    if vy + omega * rx1 >= 0.0 and vy + omega * rx2 >= 0.0:
        return vx, vy, omega, 0
    # Both carry: the face stays down, if neither corner has to pull.
    # Total normal impulse, then its split between the corners by the moment about the centre.
    pn = -vy / inverse_mass
    if pn > 0.0:
        pt = -vx / inverse_mass
        sticks = abs(pt) <= friction * pn
        if not sticks:
            pt = -friction * pn if vx > 0.0 else friction * pn
        moment = ry * pt - omega / inverse_inertia
        p1 = (moment - pn * rx2) / (rx1 - rx2)
        if p1 >= 0.0 and pn - p1 >= 0.0:
            return 0.0 if sticks else vx + inverse_mass * pt, 0.0, 0.0, 3
    # One carries and the other leaves: each is tried, by stick or slide and then jammed.
    for case in range(4):
        first = case % 2 == 0
        rx = rx1 if first else rx2
        other = rx2 if first else rx1
        vt, vn = vx - omega * ry, vy + omega * rx
        if case < 2:
            pt, pn = one_contact(vt, vn, rx, ry, inverse_mass, inverse_inertia, friction)
        else:  # under large friction a corner that is leaving can jam against the other's motion
            pt, pn = stopping_impulse(vt, vn, rx, ry, inverse_mass, inverse_inertia)
            if abs(pt) > friction * pn:
                continue
        new_vy = vy + inverse_mass * pn
        new_omega = omega + inverse_inertia * (rx * pn - ry * pt)
        if pn > 0.0 and new_vy + new_omega * other >= -SPEED_TOLERANCE:
            return vx + inverse_mass * pt, new_vy, new_omega, 1 if first else 2
    return 0.0, 0.0, 0.0, -1


@register_jitable
def _safe_time(gap, rate, bound, horizon):
    """Return the earliest time at which gap + rate t - bound t^2 / 2 can be zero.

    It returns the horizon if that is later.
    """
    # Even the fastest fall allowed by the bound stays above the ground.
    if gap + horizon * (rate - 0.5 * bound * horizon) > 0.0:
        return horizon
    root = math.sqrt(rate * rate + 2.0 * bound * gap)
    if rate < 0.0:  # comes down: the form of the root without cancellation
        return min(horizon, 2.0 * gap / (root - rate))
    if bound > 0.0:  # rises, and may be driven back
        return min(horizon, (rate + root) / bound)
    return horizon


@register_jitable
def first_impact(y, angle, vy, omega, ay, alpha, width, height, horizon, coefficient):
    """Return the first time within the horizon at which a corner comes down to the ground y = 0.

    Conservative advancement. A corner's height f has f'' >= -B with
    B = r omega^2 + 2c (r |alpha| - ay), r the half-diagonal and omega the fastest of the time
    considered. So f cannot be zero before f + f' s - B s^2/2 is, and it is safe to advance to
    that s and look again. No corner that dips and comes back is missed; near an impact the
    error is squared each time, and for a box that does not turn the first advance is exact.

    Args:
        y: height of the centre of mass [m].
        angle: [rad].
        vy: vertical velocity [m/s].
        omega: angular velocity [rad/s].
        ay: vertical acceleration, constant [m/s^2].
        alpha: angular acceleration, constant [rad/s^2].
        width: of the box [m].
        height: of the box [m].
        horizon: how far to look [s].
        coefficient: c of the flight y + tau vy + c tau^2 ay.

    Returns:
        (tau, outcome): the time of the impact and HIT; the horizon and CLEAR; or, after
        SEARCH_LIMIT evaluations, a time up to which nothing hits and UNFINISHED.
    """
    radius = 0.5 * math.sqrt(width * width + height * height)
    # Upper bound on the downward acceleration of any corner.
    fastest = abs(omega) + 2.0 * coefficient * abs(alpha) * horizon
    bound = radius * (fastest * fastest + 2.0 * coefficient * abs(alpha))
    bound = max(bound - 2.0 * coefficient * ay, 0.0)
    touch = IMPACT_TOLERANCE * radius
    tau = 0.0
    # Conservative advancement with that bound, so no impact can be skipped.
    for _ in range(SEARCH_LIMIT):
        remaining = horizon - tau
        centre = flight(y, vy, ay, tau, coefficient)
        rise = vy + 2.0 * coefficient * ay * tau
        turn = omega + 2.0 * coefficient * alpha * tau
        fall = min(remaining * rise, 0.0) + min(coefficient * ay * remaining * remaining, 0.0)
        # Above the reach of every corner up to the horizon.
        if centre + fall > radius:
            return horizon, CLEAR
        theta = flight(angle, omega, alpha, tau, coefficient)
        s = math.sin(theta)
        c = math.cos(theta)
        ws, wc = 0.5 * width * s, 0.5 * width * c
        hs, hc = 0.5 * height * s, 0.5 * height * c
        # Corners (+,+), (+,-) and their opposites: heights +-(ws +- hc), rates +-(wc -+ hs).
        advance = remaining
        for k in range(4):
            up = ws + hc if k < 2 else ws - hc
            across = wc - hs if k < 2 else wc + hs
            if k % 2 == 1:
                up = -up
                across = -across
            gap = centre + up
            rate = rise + turn * across
            if gap <= touch and rate < -SPEED_TOLERANCE:
                return tau, HIT
            # From the ground itself no progress could be proved: start a rounding above it.
            advance = min(advance, _safe_time(max(gap, 0.1 * touch), rate, bound, remaining))
        if advance >= remaining:
            return horizon, CLEAR
        tau += advance
    return tau, UNFINISHED


@register_jitable
def _time_to_turn(turn, omega, beta):
    """Return the first positive time at which omega t + beta t^2 = turn (not zero), or infinity."""
    if turn < 0.0:  # the same problem seen from the other side
        turn, omega, beta = -turn, -omega, -beta
    square = omega * omega + 4.0 * beta * turn
    if square < 0.0:  # turns back before it gets there
        return math.inf
    root = math.sqrt(square)
    if omega + root > 0.0 and omega >= 0.0:  # on its way: the form without cancellation
        return 2.0 * turn / (omega + root)
    if beta > 0.0:  # moves away now and is driven back
        return (root - omega) / (2.0 * beta)
    return math.inf


@register_jitable
def time_to_face(angle, omega, beta, horizon, flat):
    """Return when a box that pivots on a corner comes down on a face: (time, angle of that face).

    The angle moves by omega t + beta t^2. A time beyond the horizon is given as infinity.
    `flat` says that it lies on a face now and is about to leave it.
    """
    # Faces lie on the ground at multiples of a quarter turn; this is the nearest one.
    nearest = math.floor(angle / QUARTER_TURN + 0.5)
    first = math.inf
    target = angle
    if flat:
        below = nearest - 1.0
        above = nearest + 1.0
        if omega * beta < 0.0:  # leaves its face and turns back to it
            first = -omega / beta
            target = nearest * QUARTER_TURN
    else:
        below = nearest if nearest * QUARTER_TURN < angle else nearest - 1.0
        above = below + 1.0
    # Of the faces on either side, the one that the turn reaches first.
    for k in range(2):
        face = (below if k == 0 else above) * QUARTER_TURN
        time = _time_to_turn(face - angle, omega, beta)
        if time < first:
            first = time
            target = face
    if first > horizon:
        first = math.inf
    return first, target


@register_jitable
def height_on_face(angle, width, height):
    """Return the height of the centre of a box that lies on the face nearest to the angle [m]."""
    nearest = math.floor(angle / QUARTER_TURN + 0.5)
    return 0.5 * height if nearest == 2.0 * math.floor(0.5 * nearest) else 0.5 * width


@register_jitable
def lies_still(y, angle, vx, vy, omega, width, height):
    """Return true if the box lies flat on the ground and nothing moves, bit for bit."""
    if vx != 0.0 or vy != 0.0 or omega != 0.0:
        return False
    nearest = math.floor(angle / QUARTER_TURN + 0.5)
    return angle == nearest * QUARTER_TURN and y == height_on_face(angle, width, height)


@register_jitable
def collide(vx, vy, omega, corners, box, elastic):
    """Return velocities after the impact of the corners that touch: one event.

    With `elastic` the corner or face that approaches fastest bounces, otherwise all that touch
    stop without bouncing. The last of the four numbers is 1 if no case of the contact fits.
    """
    inverse_mass, width, height, inverse_inertia, restitution, friction, _ = box
    rx, ry, rx2, ry2 = corners
    vn = vy + omega * rx
    # A face lies on the ground: which part of it takes the impulse?
    both = ry2 - ry <= GAP_TOLERANCE * (width + height)
    if both:
        vn2 = vy + omega * rx2
        # Too slow to bounce: both corners stop, each as far as it must.
        if not elastic:
            middle = 0.5 * (ry + ry2)
            vx, vy, omega, active = two_contacts(
                vx, vy, omega, rx, rx2, middle, inverse_mass, inverse_inertia, friction
            )
            return vx, vy, omega, 1 if active < 0 else 0
        # It lands as a whole: one impulse at its middle, so that a flat drop bounces flat.
        if vn < 0.0 and vn2 < 0.0 and abs(vn2 - vn) <= -FACE_TOLERANCE * (vn + vn2):
            rx = 0.5 * (rx + rx2)
            ry = 0.5 * (ry + ry2)
            vn = vy + omega * rx
        # Else the faster corner goes first; the other has its turn in the next event.
        elif vn2 < vn:
            rx = rx2
            ry = ry2
            vn = vn2
    vt = vx - omega * ry
    if elastic:
        pt, pn = impact(vt, vn, rx, ry, inverse_mass, inverse_inertia, restitution, friction)
    else:
        pt, pn = one_contact(vt, vn, rx, ry, inverse_mass, inverse_inertia, friction)
    vx += inverse_mass * pt
    vy += inverse_mass * pn
    omega += inverse_inertia * (rx * pn - ry * pt)
    return vx, vy, omega, 0


@register_jitable
def collide_late(x, y, angle, vx, vy, omega, box):
    """Return contact found after the fact: reflect the velocity, push the box out of the ground."""
    width, height, rest_speed = box[1], box[2], box[6]
    corners = lowest_corners(angle, width, height)
    rx, ry, rx2, ry2 = corners
    impacts = 0
    failed = 0
    if y + ry < 0.0:
        both = ry2 - ry <= GAP_TOLERANCE * (width + height)
        # One impulse may send the other corner down, so it is looked again; the eighth and last is
        # without bounce, which ends it.
        for k in range(8):
            speed = vy + omega * rx
            if both:
                speed = min(speed, vy + omega * rx2)
            if speed >= -SPEED_TOLERANCE:
                break
            elastic = speed < -rest_speed and k < 7
            vx, vy, omega, bad = collide(vx, vy, omega, corners, box, elastic)
            impacts += 1
            failed |= bad
        y = -ry
    return x, y, angle, vx, vy, omega, impacts, failed


@register_jitable
def sustain(
    x,
    y,
    angle,
    vx,
    vy,
    omega,
    ax,
    ay,
    alpha,
    corners,
    box,
    remaining,
    coefficient,
    flat,
    first,
    second,
):
    """Move with corners on the ground, up to the end of the step or the next event.

    Events are the end of sliding and the landing of a pivoting box on its face.
    `flat`: both lowest corners touch; `first`, `second`: which of them are in contact.

    Returns:
        (x, y, angle, vx, vy, omega, time used, outcome), outcome 0: nothing holds the box on the
        ground, and it was not moved; 1: moved; -1: moved, but no case of the contact fitted.
    """
    inverse_mass, width, height, inverse_inertia, _, friction, _ = box
    rx, ry, rx2, ry2 = corners
    free_x, free_y, free_omega = vx + remaining * ax, vy + remaining * ay, omega + remaining * alpha
    active = 0
    # A face is down: both corners share the load.
    if first and second:
        ry = 0.5 * (ry + ry2)
        new_x, new_y, new_omega, active = two_contacts(
            free_x, free_y, free_omega, rx, rx2, ry, inverse_mass, inverse_inertia, friction
        )
        if active == 0:  # pushed off the ground
            return x, y, angle, vx, vy, omega, 0.0, 0
        # The face stays on the ground: it slides or rests, without turning.
        if active == 3 or active == -1:
            used = remaining
            x_rate = (new_x - vx) / remaining
            if new_x == 0.0 and vx != 0.0 and active == 3:
                # It stops within the step: slide up to that time, under the full friction.
                push = friction * free_y if vx > 0.0 else -friction * free_y
                slid = free_x + push
                if vx * slid < 0.0:
                    used = min(remaining, remaining * (vx / (vx - slid)))
                    x_rate = -vx / used
            x = flight(x, vx, x_rate, used, coefficient)
            angle = math.floor(angle / QUARTER_TURN + 0.5) * QUARTER_TURN
            y = height_on_face(angle, width, height)
            return x, y, angle, new_x, 0.0, 0.0, used, 1 if active == 3 else -1
    # One corner is down.
    else:
        if second:
            rx, ry = rx2, ry2
        # The corner is to be at rest, or slide, where it will be after it has turned.
        # Centripetal acceleration of the corner, over what is left of the step.
        turned = remaining * omega * omega
        vt = free_x - free_omega * ry - turned * rx
        vn = free_y + free_omega * rx - turned * ry
        pt, pn = one_contact(vt, vn, rx, ry, inverse_mass, inverse_inertia, friction)
        if pn <= 0.0:  # it leaves by itself
            return x, y, angle, vx, vy, omega, 0.0, 0
        new_x = free_x + inverse_mass * pt
        new_y = free_y + inverse_mass * pn
        new_omega = free_omega + inverse_inertia * (rx * pn - ry * pt)
    # One corner carries: the box pivots on it, until it comes down on a face.
    ax, ay, alpha = (
        (new_x - vx) / remaining,
        (new_y - vy) / remaining,
        (new_omega - omega) / remaining,
    )
    used, face = time_to_face(angle, omega, coefficient * alpha, remaining, flat)
    x = flight(x, vx, ax, min(used, remaining), coefficient)
    if (
        used <= remaining
    ):  # down on a face within the step: the angle is the face's, to the last bit
        new_x, new_y, new_omega = vx + used * ax, vy + used * ay, omega + used * alpha
        angle = face
        y = height_on_face(angle, width, height)
    else:  # still on its corner, which is kept on the ground
        used = remaining
        angle = flight(angle, omega, alpha, remaining, coefficient)
        _, ry, _, _ = lowest_corners(angle, width, height)
        y = -ry
    return x, y, angle, new_x, new_y, new_omega, used, 1
