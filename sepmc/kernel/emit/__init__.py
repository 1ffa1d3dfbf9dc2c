"""Emitters: functions that write the source code of the functions of a kernel, one file for each
concern.

A kernel integrates a block of cases side by side, one per lane (``l``). A case passes through
segments (phases); a segment is divided into intervals, which end at events and load switches, and
an interval into steps. Emitters append lines to a `Text`: either written by hand, or traced from
expressions of a `Scope`.

`module` assembles a kernel; `block` is its entry (segments, intervals, transitions), `steps` makes
a step, `events` locates events, `rates` is the derivative of the state. The derivative is made of
`loads`, `tables`, `guides`, `rows`, `motion` and `full`, on the kinematics of `geometry`. `start`
and `case` compute values once per case; `extension`, `wrenches`, `monitor`, `clearances` and
`history` evaluate states between the ends of steps; `energy` audits; `outcomes` writes results.

Common fields of the workspace ``w`` of a kernel, each with LANES numbers per component:

Y, T : state and time at the end of a step
S, CLOCK : state and time at a stage; D : derivative of the state at S
K1, K2, ... : derivatives at the stages; STEP : step length; END : end of the interval
REJECTED : status of a rejected case, else 0; DONE : 1 once the segment has ended
KIND_joint : number of the present kind of a joint; EVENT_TIME_event : time of an event, or inf
INDICATORS : error indicators; RESIDUAL : largest constraint residuals; ENERGY : energy audit
"""
