"""Builds the wheel of idol (PEP 517) with CMake and the standard library alone.

pip install . --config-settings build-dir=DIR keeps CMake's folder, or uses one that is there; without it a
temporary one is used. --config-settings cmake-args="-D..." passes options on.
"""

import base64
import hashlib
import os
import re
import shlex
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
METADATA = """Metadata-Version: 2.1
Name: idol
Version: {version}
Summary: Event-camera and IMU odometry with lines
License: BSD-3-Clause
Requires-Python: >=3.9
Requires-Dist: numpy
"""


def version():
    """The one that CMakeLists.txt states."""
    text = (ROOT / "CMakeLists.txt").read_text()
    return re.search(r"project\(idol VERSION (\S+)", text).group(1)


def tag():
    python = "cp{}{}".format(*sys.version_info[:2])
    platform = re.sub("[-.]", "_", sysconfig.get_platform())
    return f"{python}-{python}-{platform}"


def cmake(*arguments):
    # All to standard error, where pip looks for what a backend says.
    subprocess.run(["cmake", *arguments], check=True, stdout=sys.stderr.fileno())


def build(folder, stage, extra):
    """Configures and builds in `folder`, installs the package into `stage`."""
    wanted = ["-DIDOL_BUILD_PYTHON=ON"]
    if not (folder / "CMakeCache.txt").exists():
        wanted += ["-DCMAKE_BUILD_TYPE=Release", f"-DPython_EXECUTABLE={sys.executable}"]
        wanted += [f"-DIDOL_BUILD_{part}=OFF" for part in ("TESTS", "BENCH", "EXAMPLES")]
        # An error that names what is missing, not a build without the module.
        wanted += ["-DCMAKE_REQUIRE_FIND_PACKAGE_Python=ON", "-DCMAKE_REQUIRE_FIND_PACKAGE_pybind11=ON"]
    cmake("-S", str(ROOT), "-B", str(folder), *wanted, *extra)
    jobs = os.environ.get("CMAKE_BUILD_PARALLEL_LEVEL") or str(os.cpu_count() or 1)
    cmake("--build", str(folder), "--target", "idol_python", "-j", jobs)
    cmake("--install", str(folder), "--component", "python", "--prefix", str(stage))


def pack(stage, wheel):
    """All files of `stage` as a wheel, with the list of them that it must have."""
    info = f"idol-{version()}.dist-info"
    texts = {f"{info}/METADATA": METADATA.format(version=version()),
             f"{info}/WHEEL": f"Wheel-Version: 1.0\nGenerator: idol_build\nRoot-Is-Purelib: false\nTag: {tag()}\n"}
    files = {path.relative_to(stage).as_posix(): path.read_bytes() for path in sorted(stage.rglob("*"))
             if path.is_file()}
    files[f"{info}/LICENSE"] = (ROOT / "LICENSE").read_bytes()
    files.update((name, text.encode()) for name, text in texts.items())
    record = ""
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            record += f"{name},sha256={digest},{len(data)}\n"
            archive.writestr(name, data)
        archive.writestr(f"{info}/RECORD", record + f"{info}/RECORD,,\n")


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    settings = config_settings or {}
    extra = shlex.split(settings.get("cmake-args", ""))
    name = f"idol-{version()}-{tag()}.whl"
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(settings.get("build-dir") or Path(scratch, "build"))
        stage = Path(scratch, "stage")
        build(folder, stage, extra)
        pack(stage, Path(wheel_directory, name))
    return name


def build_sdist(sdist_directory, config_settings=None):
    """The tree as git knows it."""
    name = f"idol-{version()}"
    target = Path(sdist_directory, f"{name}.tar.gz")
    info = Path(sdist_directory, "PKG-INFO")
    info.write_text(METADATA.format(version=version()))
    subprocess.run(["git", "-C", str(ROOT), "archive", f"--prefix={name}/", f"--add-file={info}", "-o", str(target),
                    "HEAD"], check=True)
    info.unlink()
    return target.name
