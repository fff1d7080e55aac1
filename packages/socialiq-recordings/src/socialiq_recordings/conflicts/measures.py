"""Measures of a conflict by their published definitions, in s, m, m/s and m/s²."""

from __future__ import annotations

import math

INFINITE = math.inf


def post_encroachment_time(first_leaves: float, second_arrives: float) -> float:
    """Return the post-encroachment time (PET) of a conflict area, s.

    Time from the moment at which the first vehicle leaves the area to that at which the second
    arrives (Allen, Shin and Cooper 1978, Transportation Research Record 667). Below 0 if both
    were in it at once.

    Args:
        first_leaves: s; the first vehicle's rear leaves the area.
        second_arrives: s; the second vehicle's front arrives.
    """
    return second_arrives - first_leaves


def time_to_collision(gap: float, speed: float, leader_speed: float) -> float:
    """Return the time to collision (TTC) with a leader on the same path, s.

    Time until two vehicles collide if both keep their speeds and paths (Hayward 1972, Highway
    Research Record 384). Infinite if the gap does not close; 0 if there is no gap.

    Args:
        gap: Distance from the follower's front to the leader's rear, m.
        speed: The follower's, m/s.
        leader_speed: The leader's, m/s.
    """
    if gap <= 0:
        return 0.0
    closing = speed - leader_speed
    return gap / closing if closing > 0 else INFINITE


def time_to_collision_crossing(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the time to collision of two vehicles on paths that cross, s.

    With present speeds and paths they collide if both are in the conflict area at one time, when
    the later one arrives (Hayward 1972; for right angles van der Horst 1990, A time-based
    analysis of road user behaviour in normal and critical encounters, TU Delft).

    Args:
        one: s until a vehicle's front arrives at the area, and until its rear leaves.
        other: The same of the other vehicle.
    """
    arrives = max(one[0], other[0])
    meet = arrives < min(one[1], other[1])
    return max(arrives, 0.0) if meet and math.isfinite(arrives) else INFINITE


def required_deceleration(gap: float, speed: float, leader_speed: float) -> float:
    """Return the deceleration rate to avoid a crash with a leader (DRAC), m/s².

    The constant deceleration at which the follower reaches the leader's speed as the gap closes,
    (v - v_l)² / (2 gap) (Cooper and Ferguson 1976, Traffic Engineering and Control 17). 0 if the
    gap does not close; infinite if there is no gap.

    Args:
        gap: Distance from the follower's front to the leader's rear, m.
        speed: The follower's, m/s.
        leader_speed: The leader's, m/s; it keeps it.
    """
    closing = speed - leader_speed
    if closing <= 0:
        return 0.0
    return closing**2 / (2 * gap) if gap > 0 else INFINITE


def required_deceleration_crossing(gap: float, speed: float, seconds: float) -> float:
    """Return the least constant deceleration to arrive at a conflict area after some time, m/s².

    The crossing form of the same measure (Cooper and Ferguson 1976; Gettman and Head 2003,
    FHWA-RD-03-050): a vehicle that brakes from now on has not arrived before the other has left.
    Either it still moves then, v t - b t²/2 = gap, or it has stopped at the area, b = v²/(2 gap).

    Args:
        gap: Distance from the vehicle's front to the area, m.
        speed: Its speed, m/s.
        seconds: Until the other vehicle has left the area; infinite if it stands there.
    """
    if speed <= 0 or speed * seconds <= gap:
        return 0.0
    if gap <= 0:
        return INFINITE
    if speed * seconds >= 2 * gap:
        return speed**2 / (2 * gap)
    return 2 * (speed * seconds - gap) / seconds**2


def gap_accepted(before: float, after: float) -> float:
    """Return the gap in a stream through which a vehicle passed, s.

    Time between the arrivals of two successive vehicles of a stream, front to front, at the place
    where the other vehicle passed between them (Raff and Hart 1950, A volume warrant for urban
    stop signs, Eno Foundation).

    Args:
        before: s; arrival of the stream's last vehicle before the one that passed.
        after: s; arrival of the next one.
    """
    return after - before


def lag_accepted(arrives: float, after: float) -> float:
    """Return the lag that a vehicle accepted, s.

    Time from its arrival to that of the next vehicle of the stream, where none of the stream came
    before it (Raff and Hart 1950).

    Args:
        arrives: s; arrival of the vehicle that passed first.
        after: s; arrival of the stream's next vehicle.
    """
    return after - arrives
