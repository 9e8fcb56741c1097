"""The command line, see the package."""

from __future__ import annotations

import argparse
import json
import os
import pickle
import platform
import sys
import tempfile
from collections.abc import Mapping
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ..runs import ROOT, Failed, Run, run
from . import __doc__ as usage
from .problem import Problem, accurate_chi2, make, problem_of
from .table import PLACE, Column, table

ETCFIT = "etcfit"
HELPERS = ("tabulate", "absl-py", "colorama", "plotly", "imageio")  # that mujoco.sysid needs
# what each is called in the table, and the packages without which it cannot run
PEERS: dict[str, tuple[str, tuple[str, ...]]] = {
    ETCFIT: ("etcfit", ("etcfit",)),
    "scipy": ("SciPy", ("scipy",)),
    "mujoco": ("MuJoCo sysid", ("mujoco", *HELPERS)),
    "diffrax": ("Diffrax, Optimistix", ("diffrax", "optimistix")),
    "casadi": ("CasADi, IPOPT", ("casadi",)),
}


def named(names: str) -> list[str]:
    """Peers by name, all of them if there is none."""
    chosen = names.split(",") if names else list(PEERS)
    if unknown := [name for name in chosen if name not in PEERS]:
        raise argparse.ArgumentTypeError(f"no peer {', '.join(unknown)}; there are {', '.join(PEERS)}")
    return chosen


def missing(name: str) -> list[str]:
    """Packages of a peer that are not installed."""
    return [package for package in PEERS[name][1] if _version(package) is None]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def column(name: str, folder: Path, problem: Problem, scratch: Path, limit: float) -> Column:
    """What becomes of a peer; a package that is missing, a failure and a time limit are said in its words."""
    title = PEERS[name][0]
    if lacks := missing(name):
        return Column(title, {}, words=f"not measured: {', '.join(lacks)} not installed (the extra `benchmark`)")
    try:
        found = _by_etcfit(folder, scratch, limit) if name == ETCFIT else _by_peer(name, problem, scratch, limit)
    except Failed as failed:
        print("\n".join(getattr(failed, "__notes__", ())), file=sys.stderr)
        return Column(title, {}, words=f"**failed**: {failed}")
    process, values, own, words = found
    accurate = accurate_chi2(problem, values) / problem.freedom
    return Column(title, values, process.cpu, process.wall, process.peak, own, accurate, words)


def _by_peer(name: str, problem: Problem, scratch: Path, limit: float) -> tuple[Run, Mapping[str, float], float, str]:
    given, solved = scratch / "problem.pickle", scratch / f"{name}.json"
    given.write_bytes(pickle.dumps(problem))
    process = run(("-m", "benchmarks.peers.child", name, given, solved), scratch / name, ROOT, limit, core=_core())
    found = json.loads(solved.read_text(encoding="utf-8"))
    return process, found["values"], found["chi2"] / problem.freedom, found["words"]


def _by_etcfit(folder: Path, scratch: Path, limit: float) -> tuple[Run, Mapping[str, float], float, str]:
    command = ("-m", "etcfit.cli", "fit", folder, "--out", scratch / "run", "--quiet")
    process = run(command, scratch / ETCFIT, ROOT, limit, core=_core())
    told = json.loads((scratch / "run" / "fit.json").read_text(encoding="utf-8"))
    values = {symbol: p["value"] for symbol, p in told["parameters"].items()}
    return process, values, told["score"]["chi2_per_dof"], f"{len(told['starts'])} starts; {told['reason']}"


def stderr(scratch: Path) -> dict[str, float]:
    """One standard error as etcfit states it, % of its value; nothing where it was not run."""
    file = scratch / "run" / "fit.json"
    told = json.loads(file.read_text(encoding="utf-8"))["parameters"] if file.exists() else {}
    return {symbol: 100.0 * p["stderr"] / p["value"] for symbol, p in told.items() if p["stderr"]}


def _core() -> int:
    return max(os.sched_getaffinity(0))


def heading(problem: Problem, seed: int, names: list[str]) -> str:
    """The machine, the packages, the problem."""
    packages = [p for name in names for p in PEERS[name][1] if _version(p) and p not in HELPERS]
    software = ", ".join(f"{package} {_version(package)}" for package in packages)
    load = f"{os.cpu_count()} cores, shared with other work (load {os.getloadavg()[0]:.1f} before), one of them used"
    size = f"{len(problem.traces)} traces, {problem.samples} numbers, {len(problem.start)} free parameters, seed {seed}"
    return f"{date.today()}. {load}; Python {platform.python_version()}, {software}. {size}."


def arguments() -> argparse.Namespace:
    """What is wanted."""
    parser = argparse.ArgumentParser(description=usage, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", type=named, default="", metavar="NAME,NAME", help=", ".join(PEERS))
    parser.add_argument("--seed", type=int, default=1, help="of the truth and of all noise")
    parser.add_argument("--size", default="small", help="of the folder, see independent.folder")
    parser.add_argument("--limit", type=float, default=1800.0, help="s that a peer may take")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table there too, between its markers")
    return parser.parse_args()


def main() -> None:
    """Peer by peer; the file holds what is known so far, should it not come to its end."""
    choices = arguments()
    if choices.markdown:
        PLACE.must_be_in(choices.markdown)
    with tempfile.TemporaryDirectory(prefix="etcfit-peers-") as place:
        scratch = Path(place)
        folder = scratch / "folder"
        made = make(folder, choices.seed, choices.size)
        problem = problem_of(folder)
        truth = {symbol: made[symbol] for symbol in problem.start if symbol in made}
        head = heading(problem, choices.seed, choices.peers)
        print(head, file=sys.stderr, flush=True)
        columns = [
            Column(name, shown, accurate=accurate_chi2(problem, values) / problem.freedom)
            for name, values, shown in (("truth", truth, {}), ("start", problem.start, problem.start))
        ]
        for name in choices.peers:
            columns.append(column(name, folder, problem, scratch, choices.limit))
            print(f"{name}: {columns[-1]}", file=sys.stderr, flush=True)
            if choices.markdown:
                PLACE.put(choices.markdown, f"{head}\n\n{table(columns, truth, stderr(scratch))}")
        print(f"{head}\n\n{table(columns, truth, stderr(scratch))}")


if __name__ == "__main__":
    main()
