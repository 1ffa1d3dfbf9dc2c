"""Scene contents as lines of text, for ``sepmc check``."""

import numpy as np

from sepmc.kernel.spec.parameter_layout import ParameterLayout
from sepmc.scene.kinds import rows_of
from sepmc.scene.model import Condition, Motor, Scene, Signal
from sepmc.scene.terms import signal_terms


def lines(layout: ParameterLayout) -> list[str]:
    """Describe the contents of a scene for ``sepmc check``.

    Parameters
    ----------
    layout : ParameterLayout
        parameter layout of the scene, with the names of the file

    Returns
    -------
    list of str
        one line for each group of contents (bodies, joints and motors even if there are none;
        springs, loads, ... only if there are any), each phase, release, event and triggered
        ignition, two lines for each signal; a line begins with its subject, as in
        ``motors       2: retro (pushes upper forward), ...``
    """
    scene, m = layout.scene, layout.model.scene[0]
    text = [
        f"bodies       {len(layout.bodies)}: {', '.join(layout.bodies)}"
        + (" (and the ground)" if m.ground >= 0 else ""),
        f"joints       {len(layout.joints)}: "
        + _names(f"{j} ({a} - {b})" for j, (a, b) in layout.joints.items()),
        f"motors       {m.n_motors}: "
        + _names(f"{motor.name} ({_push(motor)})" for motor in scene.motor),
    ]
    for word, items in (
        ("springs", scene.spring),
        ("loads", scene.load),
        ("releases", scene.release),
        ("clearances", scene.clearance),
        ("events", scene.event),
    ):
        if items:
            text.append(f"{word:12s} {len(items)}: " + _names(item.name for item in items))
    tables = sum(
        body.aerodynamics is not None and body.aerodynamics.table is not None
        for body in scene.body.values()
    )
    text += [
        f"atmosphere   {scene.environment.atmosphere}, {m.n_terms} aerodynamic terms, {tables} "
        f"tables, {m.n_proximity} increments",
        f"gravity      {scene.environment.gravity}",
        f"solver       {scene.solver.formulation}, {scene.solver.method}, {_resolution(scene)}, "
        f"drift {scene.solver.drift}",
    ]
    for phase in scene.phase:
        rows = sum(len(rows_of(scene.joint[j], kind)) for j, kind in phase.joints.items())
        ends = f"{scene.run.end_time:g} s" if phase.until is None else condition(phase.until)
        text.append(f"phase        {phase.name}: {rows} constraint rows, until {ends}")
    for release in scene.release:
        need = ", which need not occur" if release.optional else ""
        text.append(
            f"release      {release.name}: {release.joint} becomes {release.to} when "
            f"{condition(release.when)}{need}"
        )
    for signal in scene.signal:
        text += _signal(scene, signal)
    for event in scene.event:
        text.append(f"event        {event.name}: when {condition(event.when)}")
    for motor in scene.motor:
        if motor.trigger is not None:
            text.append(f"ignition     {motor.name}: {_instant(motor)}")
    return text


def _signal(scene: Scene, signal: Signal) -> list[str]:
    """Two lines that describe a signal: first its formula, response (lag, servo, integral,
    sampling) and constants, then the paths of the parameters and aerodynamic terms it drives."""
    constants = ", ".join(f"{key} = {number:g}" for key, number in signal.constants.items())
    response = ""
    if signal.servo is not None:
        response = f", as a servo of {signal.servo.natural:g} Hz, damping {signal.servo.damping:g}"
    elif signal.lag is not None:
        response = f", with a lag of {signal.lag:g} s"
        response += f", at most {signal.rate_limit:g} a second" if signal.rate_limit else ""
    elif signal.integral:
        response = ", integrated over time"
    if signal.sample is not None:
        response = f", sampled every {signal.sample:g} s{response}"
        response += f", used {signal.delay:g} s later" if signal.delay else ""
    paths = [path for path, drive in scene.driven.items() if drive.signal == signal.name]
    paths += [path for path, name in signal_terms(scene).items() if name == signal.name]
    gives = f"gives {', '.join(paths)}" if paths else "gives no key or aerodynamic term directly"
    line = f"signal       {signal.name} = {signal.formula.strip()}{response}"
    return [line + (f", {constants}" if constants else ""), f"             {gives}"]


def _instant(motor: Motor) -> str:
    """Ignition of a motor with a trigger (an event, a release, or a joint that becomes free), in
    words, such as ``0.2 s later than at event clear``."""
    trigger = motor.trigger
    assert trigger is not None
    instant = (
        f"as {trigger.joint} becomes free"
        if trigger.joint is not None
        else f"at event {trigger.event}"
        if trigger.event is not None
        else f"at release {trigger.release}"
    )
    later = trigger.delay + motor.delay
    return f"{later:g} s later than {instant}" if later else instant


def _resolution(scene: Scene) -> str:
    """Accuracy of the solver or, if the scene gives one, its fixed step in s, in words."""
    return (
        f"accuracy {scene.solver.accuracy:g}"
        if scene.solver.step is None
        else f"step {scene.solver.step:g} s"
    )


def _push(motor: Motor) -> str:
    """Direction in which a motor pushes its body, in words: ``pushes upper forward`` (or aft, or
    sideways, if the nominal cant is between 60 and 120 deg)."""
    forward = float(np.cos(motor.cant))
    return f"pushes {motor.body} " + (
        "forward" if forward > 0.5 else "aft" if forward < -0.5 else "sideways"
    )


def _names(names) -> str:
    """Names joined by commas; "none" without names."""
    return ", ".join(names) or "none"


def condition(until: Condition) -> str:
    """Describe a condition of a phase, a release or an event in words.

    Parameters
    ----------
    until : Condition

    Returns
    -------
    str
        such as ``1.5 s or bolt at 20 mm``; alternatives are joined by "or", conditions that must
        all be met are in parentheses, joined by "and"
    """
    terms = [f"{until.time:g} s"] if until.time is not None else []
    terms += [f"burn-out of {until.burn_out}"] if until.burn_out is not None else []
    terms += [f"spring {until.spring} at its end"] if until.spring is not None else []
    terms += [f"{until.joint} at {1e3 * until.stroke:g} mm"] if until.stroke is not None else []
    terms += (
        [f"{until.joint} {1e3 * until.distance:g} mm away"] if until.distance is not None else []
    )
    terms += (
        [f"{until.joint} turned by {np.degrees(until.angle):g} deg"]
        if until.angle is not None
        else []
    )
    terms += [f"force of {until.joint} {until.force:g} N"] if until.force is not None else []
    terms += [f"moment of {until.joint} {until.moment:g} N m"] if until.moment is not None else []
    terms += [f"{until.body} at {until.altitude:g} m height"] if until.altitude is not None else []
    terms += (
        [f"{until.body} at {until.vertical_speed:g} m/s upward"]
        if until.vertical_speed is not None
        else []
    )
    if until.direction is not None:  # of the only quantity, the last term
        terms[-1] += f" ({until.direction})"
    terms += [condition(item) for item in until.any]
    if until.all:
        terms.append("(" + " and ".join(condition(item) for item in until.all) + ")")
    return " or ".join(terms)
