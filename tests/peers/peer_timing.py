"""What the peers' timings share: models, scene, and the clock. A row prints its least microseconds a call, and its name."""
import json
import pathlib
import sys
import time

MODELS = pathlib.Path(__file__).resolve().parent / "models"
SCENE = json.loads((MODELS / "scene.json").read_text())
DT = SCENE["dt"]
# Seconds of one repetition, and how many there are.
REPETITION, REPETITIONS = 0.08, 9


def model(name):
    return str(MODELS / f"{name}.urdf")


def start(which):
    """Positions, velocities, efforts of the arm."""
    return [SCENE[which][key] for key in ("q", "v", "tau")]


def row(name, calls, round_, before=lambda: None):
    """Times `round_`, which makes `calls` calls, by the processor time of the whole process; `before` is not timed."""
    before()
    clock = time.process_time()
    round_()
    once = max(time.process_time() - clock, 1e-7)
    least = float("inf")
    for _ in range(REPETITIONS):
        spent, rounds = 0.0, 0
        while spent < REPETITION or rounds == 0:
            before()
            inner = 1 if before.__name__ != "<lambda>" else max(1, int(REPETITION / once))
            clock = time.process_time()
            for _ in range(inner):
                round_()
            spent += time.process_time() - clock
            rounds += inner
        least = min(least, spent / (rounds * calls) * 1e6)
    print(f"{least:.3f}\t{name}", flush=True)


def version(text):
    print(f"# {text}", flush=True)


def failed(name, error):
    print(f"# {name}: {' '.join(str(error).split())[:200]}", file=sys.stderr, flush=True)
