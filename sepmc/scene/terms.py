"""Names of the terms of aerodynamic polynomials, such as ``alpha2_q``, or of signals."""

import re

from sepmc.scene.model import COEFFICIENTS, Scene

# terms of a polynomial; any other is the name of a signal
TERM = re.compile(r"^(const|((alpha[2-5]?)(_beta[2-5]?)?|beta[2-5]?)(_[pqr])?|[pqr])\Z")


def signal_of(term: str) -> str:
    """Name of the signal that a term of a polynomial is proportional to, which is the term's name;
    empty for the constant term and terms of angles and rates."""
    return "" if TERM.match(term) else term


def signal_terms(scene: Scene) -> dict[str, str]:
    """Names of the signals that terms of aerodynamic polynomials are proportional to, by the path
    of the term's coefficient, which ends in that name: ``body.upper.aerodynamics.axial.throttle``.
    The constant term and terms of angles and rates are left out."""
    return {
        f"body.{name}.aerodynamics.{coefficient}.{term}": term
        for name, body in scene.body.items()
        if body.aerodynamics is not None
        for coefficient in COEFFICIENTS
        for term in getattr(body.aerodynamics, coefficient)
        if signal_of(term)
    }
