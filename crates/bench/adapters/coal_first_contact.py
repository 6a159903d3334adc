"""Coal: whether tool and part touch, with the first contact that is found. Less than a wrench: times alone."""

from importlib.metadata import version

import coal
import coal_models
import wrench_csv


def prepare(folder):
    part = coal_models.part(folder)
    tool, kind = coal_models.tool(folder)
    request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1)
    request.gjk_initial_guess = coal.GJKInitialGuess.CachedGuess
    result, fixed = coal.CollisionResult(), coal.Transform3s.Identity()

    def ask(position, quaternion):
        result.clear()
        coal.collide(part, fixed, tool, coal_models.transform(position, quaternion), request, result)

    return f"Coal {version('coal')}: {kind} of the tool, the part's triangles as they are; `collide` with one contact", ask, None


wrench_csv.main(prepare)
