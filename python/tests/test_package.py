"""Stubs, the package that pip makes, and the example."""

import ast
import importlib.util
import inspect
import os
import subprocess
import sys
import zipfile

import pytest

import idol
from conftest import DEMO, ROOT, program
from idol import _core

# What every module has.
HIDDEN = {"__doc__", "__name__", "__file__", "__loader__", "__package__", "__spec__"}


def members(nodes):
    names = {}
    for node in nodes:
        if isinstance(node, ast.ClassDef):
            names[node.name] = node
        elif isinstance(node, ast.FunctionDef):
            names[node.name] = node
        elif isinstance(node, ast.AnnAssign):
            names[node.target.id] = node
    return names


def test_stubs_know_what_the_module_has():
    stub = members(ast.parse((ROOT / "python/idol/_core.pyi").read_text()).body)
    assert set(vars(_core)) - HIDDEN == set(stub)
    for name, node in stub.items():
        if not isinstance(node, ast.ClassDef) or issubclass(getattr(_core, name), Exception):
            continue
        here = {member for member in vars(getattr(_core, name)) if not member.startswith(("__", "_pybind11"))}
        assert here == {member for member in members(node.body) if not member.startswith("__")}, name


def test_everything_public_is_documented():
    for name in idol.__all__:
        assert not callable(getattr(idol, name)) or inspect.getdoc(getattr(idol, name)), name
    assert program("--version") == f"idol {idol.__version__}\n"
    assert (ROOT / "python/idol/py.typed").exists()


def test_pip_installs_from_the_source_tree(tmp_path):
    """Into an environment of its own, with CMake's folder of this build; neither an index nor wheels are asked."""
    if importlib.util.find_spec("venv") is None or importlib.util.find_spec("ensurepip") is None:
        pytest.skip("no venv")
    environment = {name: value for name, value in os.environ.items()
                   if name != "PYTHONPATH" and not name.startswith("PIP_")}
    environment["PIP_NO_INDEX"] = "1"
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--no-build-isolation", ROOT, "--config-settings",
                    f"build-dir={os.environ['IDOL_BUILD_DIR']}"], check=True, env=environment, cwd=tmp_path)
    script = ("import sys, idol; r = idol.run(sys.argv[1], to_s=1.5); "
              "print(idol.__file__, len(r.states), idol.ready_rigs()[0], idol.load_rig('davis240c').width)")
    said = subprocess.run([python, "-c", script, DEMO], check=True, env=environment, cwd=tmp_path, text=True,
                          stdout=subprocess.PIPE).stdout.split()
    assert said[0].startswith(str(tmp_path / "venv"))
    assert int(said[1]) > 10 and said[2:] == ["davis240c", "240"]


def test_wheel_lists_its_files(tmp_path):
    sys.path.insert(0, str(ROOT / "python"))
    try:
        import idol_build
    finally:
        sys.path.pop(0)
    (tmp_path / "stage" / "idol").mkdir(parents=True)
    (tmp_path / "stage" / "idol" / "__init__.py").write_text("x = 1\n")
    idol_build.pack(tmp_path / "stage", tmp_path / "w.whl")
    with zipfile.ZipFile(tmp_path / "w.whl") as wheel:
        record = wheel.read(f"idol-{idol.__version__}.dist-info/RECORD").decode()
        assert {line.split(",")[0] for line in record.split()} == set(wheel.namelist())


def test_the_example_of_the_readme_runs():
    block = (ROOT / "README.md").read_text().split("```python\n")[1].split("```")[0]
    said = subprocess.run([sys.executable, "-c", block + "print(len(odometry.states))"], check=True, cwd=ROOT, text=True,
                          stdout=subprocess.PIPE).stdout.split()
    assert "lines" in said and int(said[-1]) > 100


def test_example_draws_a_picture(tmp_path):
    if importlib.util.find_spec("matplotlib") is None:
        pytest.skip("no matplotlib")
    picture = tmp_path / "picture.png"
    said = subprocess.run([sys.executable, ROOT / "examples" / "plot_trajectory.py", DEMO, "--to", "2", "--out",
                           picture], check=True, text=True, stdout=subprocess.PIPE).stdout
    assert "poses" in said
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and picture.stat().st_size > 20000
