"""How long each filter takes per unit of work, for the plan's estimates.

    python benchmarks/fit_rates.py out1/totem.mlp out2/totem.mlp out3/another.mlp ...

Each result tells the CPU seconds of its filters and how much there was to do. Least squares over
relative errors, no rate negative, gives the table RATES of meshlab_svbrdf/planning/cost.py, and how
far each result lies from it. Results of several films, sizes and numbers of frames are needed to
tell the amounts apart. Runs that compiled kernels do not count.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.optimize import nnls

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.plan import try_frames
from meshlab_svbrdf.planning.cost import RATES, SAMPLES, Work, yardstick


def work_of(document: Document) -> Work:
    """How much there was to do."""
    runs, texels = document.results.record["runs"], document.texels()
    frames = [f for f in document.json("frames")["frames"] if "samples" in f]
    used = {frame["label"] for frame in frames}
    trial = try_frames(
        document.mesh(), [r for r in document.rasters if r.label in used],
        _given(runs, SAMPLES), len(texels), document.json("frames")["reduce"],
    )  # fmt: skip
    assert trial is not None
    shot = document.array("visibility").shape[0]
    return Work(
        frames=len(frames), samples=sum(frame["samples"] for frame in frames), texels=len(texels),
        vertices=shot, environment=_given(runs, "generate_svbrdf_environment_map").samples,
        fitted=_given(runs, "compute_svbrdf_material_specular").samples,
        directions=_given(runs, "compute_svbrdf_visibility").directions, cores=1,
        decode=trial.decode, project=trial.project,
    )  # fmt: skip


def _given(runs, name: str):
    return argparse.Namespace(**runs[name]["parameters"])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("projects", nargs="+", help="results, such as out/totem.mlp")
    every = [Document.open(path) for path in parser.parse_args().projects]
    work = {id(document): work_of(document) for document in every}
    for name, rate in RATES.items():
        documents = [d for d in every if name in d.results.record["runs"]]
        if not documents:
            print(f'"{name}": in no result')
            continue
        works = [work[id(document)] for document in documents]
        taken = np.array([d.results.record["runs"][name]["cpu_seconds"] for d in documents])
        measured = np.array(
            [w.frames * (w.decode + w.project) if name == SAMPLES else 0.0 for w in works]
        )
        amounts = np.array([[w.amounts()[what] for what in rate.seconds] for w in works])
        found, _ = nnls(amounts / taken[:, None], 1 - measured / taken)
        off = (amounts @ found + measured) / taken - 1
        told = ", ".join(f'"{k}": {v:.3g}' for k, v in zip(rate.seconds, found, strict=True))
        apart = ", ".join(f"{x:+.0%}" for x in off)
        print(f'"{name}": Rate({rate.shared}, {{{told}}}),  # off {apart}')
    print(f"MEASURED_YARDSTICK = {yardstick(50):.4f}")


if __name__ == "__main__":
    main()
