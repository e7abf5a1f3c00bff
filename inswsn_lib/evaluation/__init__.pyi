from .clusters import (
    cluster_mean as cluster_mean,
    cluster_median as cluster_median,
    cluster_share as cluster_share,
)
from .consistency import (
    FALSE_ALARM as FALSE_ALARM,
    NoiseFit as NoiseFit,
    Statistic as Statistic,
    autocorrelation as autocorrelation,
    colour as colour,
    fit_noise as fit_noise,
    independent_count as independent_count,
    ljung_box as ljung_box,
    log_likelihoods as log_likelihoods,
    mean_bounds as mean_bounds,
    mean_square as mean_square,
    normalised_squares as normalised_squares,
    whiteness as whiteness,
)
from .drift import (
    MOTIONS as MOTIONS,
    DriftBound as DriftBound,
    Motion as Motion,
    drift_bound as drift_bound,
    longest_period as longest_period,
)
from .error_ratios import block_ratio as block_ratio
from .metrics import (
    Spread as Spread,
    largest_error as largest_error,
    mean_absolute_error as mean_absolute_error,
    root_mean_square_error as root_mean_square_error,
    spread as spread,
)
from .monte_carlo import GROUP as GROUP, monte_carlo as monte_carlo
from .scores import (
    Finding as Finding,
    Lead as Lead,
    Leader as Leader,
    Prediction as Prediction,
    Score as Score,
    Scores as Scores,
    crps as crps,
    paired_lead as paired_lead,
    quotient as quotient,
    score_hypothesis as score_hypothesis,
)
from .tuning import (
    Tuning as Tuning,
    most_likely as most_likely,
    search_pattern as search_pattern,
    tune as tune,
)
