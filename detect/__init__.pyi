from .background import Background as Background
from .global_rx import residual_rx as residual_rx
from .global_rx import rx as rx
from .global_rx import rx_utd as rx_utd
from .global_rx import subspace_rx as subspace_rx
from .global_rx import utd as utd
from .lines import LineScorer as LineScorer
from .lines import score_lines as score_lines
from .local import local_rx as local_rx
from .objects import Object as Object
from .pipeline.recipe import Recipe as Recipe
from .pipeline.run import Result as Result
from .pipeline.run import score_file as score_file
from .roc.curve import Roc as Roc
from .sea.search import Search as Search
from .sea.search import score_scene as score_scene
from .threshold import Tail as Tail
from .threshold import Threshold as Threshold

__version__: str
