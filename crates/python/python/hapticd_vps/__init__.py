from . import hapticd_vps as _module
from .hapticd_vps import *  # noqa: F403

__doc__, __all__, __version__ = _module.__doc__, _module.__all__, _module.__version__
