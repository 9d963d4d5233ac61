from .errors import DeglintError as DeglintError
from .info import examine as examine
from .pipeline.fit import Fitted as Fitted
from .pipeline.fit import fit_scene as fit_scene
from .pipeline.outputs import Result as Result
from .pipeline.recipe import Recipe as Recipe
from .pipeline.run import correct as correct
from .pipeline.run import remove_glint as remove_glint
from .readers.opening import open_scene as open_scene
from .readers.roles import find_nir as find_nir
from .remove import METHODS as METHODS
from .remove import GlintModel as GlintModel
from .remove import apply as apply
from .remove import fit as fit
from .scene import Band as Band
from .scene import Scene as Scene

__version__: str
