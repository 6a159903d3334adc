"""Coal: distance of tool and part with the nearest points. Less than a wrench: times alone."""

from importlib.metadata import version

import coal
import coal_models
import wrench_csv


def prepare(folder):
    part = coal_models.part(folder)
    tool, kind = coal_models.tool(folder)
    request = coal.DistanceRequest(True)
    request.gjk_initial_guess = coal.GJKInitialGuess.CachedGuess
    result, fixed = coal.DistanceResult(), coal.Transform3s.Identity()

    def ask(position, quaternion):
        result.clear()
        coal.distance(part, fixed, tool, coal_models.transform(position, quaternion), request, result)

    return f"Coal {version('coal')}: {kind} of the tool, the part's triangles as they are; `distance` with nearest points", ask, None


wrench_csv.main(prepare)
