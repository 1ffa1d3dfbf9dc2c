"""sepmc: Monte Carlo of multi-body stage separation by the constraint force equation method."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("sepmc")
except PackageNotFoundError:  # run from a bare tree
    __version__ = "0+unknown"

__all__ = ["RunWarning", "SceneError", "SceneWarning", "__version__", "load"]


def __getattr__(name: str):  # the heavy parts are imported when first used
    if name == "load":
        from sepmc.campaign.campaign import load  # noqa: PLC0415

        return load
    if name in ("RunWarning", "SceneError", "SceneWarning"):
        from sepmc.scene import messages  # noqa: PLC0415

        return getattr(messages, name)
    raise AttributeError(f"module 'sepmc' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
