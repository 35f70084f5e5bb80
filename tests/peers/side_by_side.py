#!/usr/bin/env python3
"""Times this project beside its peers, on one core, in turns, and prints the table.

    python3 tests/peers/side_by_side.py [--python PEER=INTERPRETER].. [--venvs FOLDER] [--rounds 2] [--core 0] [--only PEER,..]

A peer runs in the interpreter that `--python` names for it, else in FOLDER/PEER/bin/python, else in this one. Peers that are not
installed are named and left out. Each figure is the least microseconds a call over all rounds; only their ratios say something.
"""
import argparse
import importlib.util
import json
import os
import pathlib
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
# Peer: what its script imports.
PEERS = {
    "pinocchio": "pinocchio",
    "mujoco": "mujoco",
    "crocoddyl": "crocoddyl",
    "drake": "pydrake",
    "pybullet": "pybullet",
    "nimble": "nimblephysics",
}
# Row: the peer that its target is set against, and the ratio to stay below; None where no peer has such a thing.
TARGETS = {
    "forward dynamics": ("pinocchio", 1.0 / 1.65),
    "its derivatives by q, v, tau": ("pinocchio", 2.0 / 4.13),
    "free step": ("mujoco", 1.5 / 3.06),
    "free step + A, B": ("pinocchio", 3.0 / 5.0),
    "gripping step, 8 contacts": ("mujoco", 6.0 / 8.3),
    "gripping step + A, B": ("mujoco", 18.0 / 168.0),
    "the same + every parameter": None,
    "1,000 free steps + gradient": ("pinocchio", 4500.0 / 9006.0),
    "300 gripping steps + gradient": ("mujoco", 5400.0 / 55516.0),
    "DDP, 7-dof reach, 100 knots, one iteration": ("crocoddyl", 800.0 / 1683.0),
    "DDP, 7-dof reach, 100 knots, whole solve": ("crocoddyl", 4500.0 / 9615.0),
}


def benches():
    """Builds our benches and gives their programs."""
    command = ["cargo", "bench", "-p", "sagci-dynamics", "-p", "sagci-planning", "--benches", "--no-run", "--message-format=json"]
    built = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    messages = [json.loads(line) for line in built.splitlines() if line.startswith("{")]
    ours = [m for m in messages if m["reason"] == "compiler-artifact" and "bench" in m["target"]["kind"] and m["executable"]]
    return [[m["executable"], "--bench"] for m in ours]


def interpreter(peer, options):
    """The peer's Python, or None where it is not installed."""
    own = dict(pair.split("=", 1) for pair in options.python)
    folder = pathlib.Path(options.venvs) / peer / "bin" / "python" if options.venvs else None
    if peer in own:
        found = own[peer]
    elif folder and folder.exists():
        found = str(folder)
    else:
        return sys.executable if importlib.util.find_spec(PEERS[peer]) else None
    look = subprocess.run([found, "-c", f"import {PEERS[peer]}"], capture_output=True)
    return found if look.returncode == 0 else None


def run(command, core):
    """Lines of a program that is kept on one core."""
    pinned = ["taskset", "-c", str(core), *command] if shutil.which("taskset") else command
    done = subprocess.run(pinned, cwd=HERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        print(f"  failed: {' '.join(command)}\n  {done.stderr.strip()[-300:]}")
    return done.stdout.splitlines()


def ours_of(lines):
    """Our rows: `median least  name`."""
    for line in lines:
        parts = line.split(None, 2)
        if len(parts) == 3 and not line.startswith("#"):
            try:
                yield parts[2], float(parts[1])
            except ValueError:
                pass


def theirs_of(lines):
    """A peer's rows: `least<TAB>name`."""
    for line in lines:
        time, tab, name = line.partition("\t")
        if tab:
            yield name, float(time)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", action="append", default=[], metavar="PEER=INTERPRETER")
    parser.add_argument("--venvs", metavar="FOLDER")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--core", type=int, default=0)
    parser.add_argument("--only", default=",".join(PEERS), help="peers, by commas")
    options = parser.parse_args()
    wanted = [p for p in options.only.split(",") if p]
    if unknown := [p for p in wanted if p not in PEERS]:
        parser.error(f"no peer {', '.join(unknown)}; there are {', '.join(PEERS)}")
    programs = benches()
    # Pinocchio's program takes minutes to build: it stays with ours.
    kept = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "peers"
    kept.mkdir(parents=True, exist_ok=True)
    peers = {}
    for peer in wanted:
        if python := interpreter(peer, options):
            peers[peer] = [python, str(HERE / f"time_{peer}.py")] + ([str(kept)] if peer == "pinocchio" else [])
        else:
            print(f"# {peer} is not installed: left out")
    ours, theirs = {}, {}
    for round_ in range(options.rounds):
        # Ours before each peer, so that no two figures of a ratio are far apart in time.
        for peer, command in peers.items() or [(None, None)]:
            for program in programs:
                for name, time in ours_of(run(program, options.core)):
                    ours[name] = min(time, ours.get(name, time))
            lines = run(command, options.core) if command else []
            for line in lines:
                if line.startswith("# ") and round_ == 0:
                    print(f"# {peer}: {line[2:]}", flush=True)
            for name, time in theirs_of(lines):
                theirs[name, peer] = min(time, theirs.get((name, peer), time))
    print("\n| row | peer | its us | ours us | ratio | target | met |\n|---|---|---|---|---|---|---|")
    for name, target in TARGETS.items():
        if name not in ours:
            print(f"| {name} | | | not measured | | | |")
            continue
        found = sorted((time, peer) for (row, peer), time in theirs.items() if row == name)
        against, aim = target or (None, None)
        if not any(peer == against for _, peer in found):
            print(f"| {name} | {f'{against}, not here' if against else 'nobody'} | | {ours[name]:.2f} | | {f'{aim:.2f}' if aim else ''} | |")
        for time, peer in found:
            ratio = ours[name] / time
            verdict = f"{aim:.2f} | {'yes' if ratio <= aim else 'no'}" if peer == against else " | "
            print(f"| {name} | {peer} | {time:.2f} | {ours[name]:.2f} | {ratio:.2f} | {verdict} |")


if __name__ == "__main__":
    main()
