"""Compiles time_pinocchio.cpp against the headers of the installed wheel (`pip install "pin[build]"`), and runs it."""
import pathlib
import subprocess
import sys
import tempfile

import pinocchio
from peer_timing import model, start, version

version(f"Pinocchio {pinocchio.__version__} in C++")
prefix = next(p for p in pathlib.Path(pinocchio.__file__).parents if p.name == "cmeel.prefix")
kept = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else pathlib.Path(tempfile.mkdtemp())
program = kept / "time_pinocchio"
source = pathlib.Path(__file__).with_suffix(".cpp")
if not program.exists() or program.stat().st_mtime < source.stat().st_mtime:
    # What Pinocchio's own CMake target defines, and the instantiations of its library.
    defines = ["BOOST_MPL_LIMIT_LIST_SIZE=30", "BOOST_MPL_LIMIT_VECTOR_SIZE=30", "BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS"]
    defines += ["BOOST_FUSION_INVOKE_MAX_ARITY=12", "PINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION", "NDEBUG"]
    command = ["g++", "-std=c++20", "-O3", "-w", *(f"-D{d}" for d in defines), f"-I{prefix}/include", f"-I{prefix}/include/eigen3"]
    command += [str(source), "-o", str(program), f"-L{prefix}/lib"]
    subprocess.run([*command, "-lboost_serialization", "-lpinocchio_default", f"-Wl,-rpath,{prefix}/lib"], check=True)
pinocchio.buildModelFromUrdf(model("panda")).saveToText(str(kept / "panda.txt"))
(kept / "state.txt").write_text(" ".join(str(x) for part in start("free") for x in part))
sys.exit(subprocess.run([str(program), str(kept / "panda.txt"), str(kept / "state.txt")]).returncode)
