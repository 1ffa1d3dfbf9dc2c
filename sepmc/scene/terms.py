"""Terms of aerodynamic polynomials."""

import re

from sepmc.scene.model import COEFFICIENTS, Scene

# terms of a polynomial; any other is the name of a signal
TERM = re.compile(r"^(const|((alpha[2-5]?)(_beta[2-5]?)?|beta[2-5]?)(_[pqr])?|[pqr])\Z")


def signal_of(term: str) -> str:
    """Name of the signal that a term of a polynomial multiplies; empty for other terms."""
    return "" if TERM.match(term) else term


def signal_terms(scene: Scene) -> dict[str, str]:
    """Signals that terms of aerodynamic polynomials multiply, by the paths of the terms."""
    return {
        f"body.{name}.aerodynamics.{coefficient}.{term}": term
        for name, body in scene.body.items()
        if body.aerodynamics is not None
        for coefficient in COEFFICIENTS
        for term in getattr(body.aerodynamics, coefficient)
        if signal_of(term)
    }
