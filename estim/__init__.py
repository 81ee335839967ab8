"""estim: uncertainty and Bayesian parameter estimation for lab experiments.  Start with
`estim.pipeline`.

The names that it offers stand in `__init__.pyi`, and are loaded when they are first used (PEP 562),
so that `import estim` and `estim --help` are quick.  None of them is the name of a file in this
folder: importing a file binds its name here, and would put the module in the place of the function.
Nothing is imported here: under `python -m estim` a file beside the data may stand for a module
until `estim.__main__` has taken the working folder off the path.
"""


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name == "__version__":
        return import_module("estim.versions").version("estim")
    homes = _homes()
    if name != "__all__" and name not in homes:
        raise AttributeError(f"module 'estim' has no attribute {name!r}")
    found = sorted(homes) if name == "__all__" else getattr(import_module(homes[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(_homes())


def _homes() -> dict[str, str]:
    """Name -> the module that has it, of the imports in the stub."""
    import ast

    with open(__file__ + "i", encoding="utf-8") as stub:
        imports = [line for line in ast.parse(stub.read()).body if isinstance(line, ast.ImportFrom)]
    return {alias.name: str(line.module) for line in imports for alias in line.names}
