"""A Python policy as a program of the line protocol (docs/policies.md); it is never imported.

    python python_child.py PLACE ATTRIBUTE PATHS

PLACE is a module's name, or a JSON list of the file whose source is run (no compiled one, which may
hold other code) and of the path that it has by name; ATTRIBUTE is a policy (it has
`predict`), a class that makes one without arguments, or a function of observations; PATHS is a JSON
list, the module search path. The module's code runs in this process alone.
"""

import importlib
import importlib.util
import inspect
import json
import os
import sys
from pathlib import Path
from typing import Any

MOST = 400  # characters of an error


def main(source: str, attribute: str, paths: list[str]) -> int:
    """Load the policy and answer every line of the standard input.

    Args:
        source: PLACE of the command line: a module's name, or a JSON list of a file and its path.
        attribute: Name of the policy in the module.
        paths: Module search path.

    Returns:
        Exit status 0.
    """
    # What the module prints goes to the standard error: the standard output is for answers.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    sys.path[:] = paths
    policy = None
    size = 0
    for line in sys.stdin:
        message = json.loads(line)
        try:
            if policy is None:
                policy = getattr(_module(source), attribute)
                size = message.get("action_size", 0)
                policy = policy() if inspect.isclass(policy) else policy
                if not callable(getattr(policy, "predict", policy)):
                    policy = "is not a policy: it must be a function or have `predict`"
                answer = message
            else:
                answer = {"id": message["id"], **_decided(policy, message, size)}
        except (Exception, SystemExit) as error:
            answer = {"error": f"raised {type(error).__name__}: {error}; correct its code"[:MOST]}
        if isinstance(policy, str):
            answer = {"error": policy}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
    return 0


def _module(source: str) -> Any:
    if not source.startswith("["):
        return importlib.import_module(source)
    file, name = json.loads(source)
    path = Path(name)
    sys.path.append(str(path.parent))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up there.
    sys.modules.setdefault(path.stem, module)
    exec(compile(Path(file).read_bytes(), name, "exec"), module.__dict__)
    return module


def _decided(policy: Any, message: dict[str, Any], size: int) -> dict[str, Any]:
    """Return the actions of a request, or an error if they have another type or shape."""
    import numpy as np

    batch = np.array(message["observations"], np.float32)
    if hasattr(policy, "predict"):
        answer = policy.predict(batch, deterministic=message["deterministic"])[0]
    else:
        answer = policy(batch)
    try:
        actions = np.asarray(answer)
    except (ValueError, TypeError):  # rows of several lengths
        return {"error": "must answer one action for each observation"}
    shape = (len(batch),)
    kinds = "iu"
    what = "one integer"
    if size:
        shape = len(batch), size
        kinds = "iuf"
        what = f"{size} number(s)"
    if actions.shape != shape or actions.dtype.kind not in kinds:
        return {
            "error": f"answered {actions.dtype} of shape {actions.shape}: it must be {what} "
            f"for each of {len(batch)} observations"
        }
    return {"actions": actions.tolist()}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], json.loads(sys.argv[3])))
