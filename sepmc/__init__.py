"""sepmc: Monte Carlo simulation of multi-body stage separation by the constraint force equation
method."""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign, load
    from sepmc.campaign.definition import Case
    from sepmc.campaign.execution.work_ranges import StaleWorkerError
    from sepmc.campaign.result import Result
    from sepmc.campaign.run_options import RunOptions
    from sepmc.campaign.session import DesignResult, DesignTable, Session
    from sepmc.campaign.store.untrusted import StoreError
    from sepmc.campaign.stored_result import open
    from sepmc.report.flight_figure import draw_flight
    from sepmc.scene.messages import InputError, RunWarning, SceneError, SceneWarning

try:
    __version__ = version("sepmc")
except PackageNotFoundError:  # a source tree that is not installed
    __version__ = "0+unknown"

__all__ = [
    "Campaign",
    "Case",
    "DesignResult",
    "DesignTable",
    "InputError",
    "Result",
    "RunOptions",
    "RunWarning",
    "SceneError",
    "SceneWarning",
    "Session",
    "StaleWorkerError",
    "StoreError",
    "__version__",
    "draw_flight",
    "load",
    "open",
]

# module of each public name, imported at first use: `import sepmc` stays light
_MODULES = {
    "Campaign": "campaign.campaign",
    "Case": "campaign.definition",
    "DesignResult": "campaign.session",
    "DesignTable": "campaign.session",
    "InputError": "scene.messages",
    "Result": "campaign.result",
    "RunOptions": "campaign.run_options",
    "RunWarning": "scene.messages",
    "SceneError": "scene.messages",
    "SceneWarning": "scene.messages",
    "Session": "campaign.session",
    "StaleWorkerError": "campaign.execution.work_ranges",
    "StoreError": "campaign.store.untrusted",
    "draw_flight": "report.flight_figure",
    "load": "campaign.campaign",
    "open": "campaign.stored_result",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"sepmc.{_MODULES[name]}"), name)
    raise AttributeError(f"module 'sepmc' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
