"""All claims, in the order of the page."""

from typing import Final

from benchmarks.claims.claim import PublishedClaim

_BITS: Final = "The same bits"
_RADIO: Final = "The radio"
_NAVIGATION: Final = "Navigation"
_ENDS: Final = "Ends, losses, damage"
_BOARD: Final = "On board"
_CORNERS: Final = ("alone/corridor/360/exact/0", "crowd/apartment/360/kobuki/10/robust")
_FEW_CASES: Final = (("robot", "killed"), ("base", "stopped"), ("lidar", "silent"))

CLAIMS: Final = (
    PublishedClaim(
        "same-bits", _BITS,
        "A run follows from scenario, seed and commit; a strategy from its inputs only.",
        "One digest in memory and over processes, sandboxed or not, at any speed; replayed with another hash "
        "seed, every message is equal. Tests do it on every change.",
        "benchmarks.foundations.same_bits", small={"duration": 5.0}, full={"duration": 120.0},
        seconds=(15, 90), takes=("duration",),
    ),
    PublishedClaim(
        "processors", _BITS,
        "The digest is the same on any processor.",
        "Equal digests of two runs on x86-64 with and without AVX-512, AVX2 and FMA, on emulated aarch64, "
        "with Python 3.11 to 3.13 ([decision 11](decisions/0011-portable-functions.md)).",
        "benchmarks.processors.table", small={"duration": 5.0, "only": ("x86_64", "FMA")},
        full={"duration": 600.0}, seconds=(120, 5400), takes=("duration", "only", "install"),
    ),
    PublishedClaim(
        "container", _BITS,
        "A run in the container has the digest that it has outside.",
        "Recipes for Docker and Apptainer, carried out in a bare Debian tree: the same digest and commit, "
        "robots isolated; without a network, nothing installed or compiled before the run "
        "([containers](clusters.md#in-a-container)).",
        "benchmarks.container.command", small={"build": False}, full={}, seconds=(1, 600), takes=("install",),
    ),
    PublishedClaim(
        "functions", _BITS,
        "Elementary functions are our own and exact.",
        "Within 2.5 ulp of mpmath at most, 1 ulp for most.",
        "benchmarks.foundations.portable", small={"count": 200}, full={"count": 5000}, seconds=(5, 40),
    ),
    PublishedClaim(
        "radio", _RADIO,
        "The medium behaves as ns-3.44's lr-wpan (C++) with one correction, and as the closed formula of one "
        "backlogged sender.",
        "744 of 772 comparisons lie within the joint 95 % interval, none further off than 3.27 standard "
        "errors; the formula is met within 0.05 %. Without `--data DIR`, rows of ns-3, only the formula is "
        "checked.",
        "benchmarks.radio.truth", small={"runs": 20}, full={"runs": 10}, seconds=(3, 300),
        takes=("data", "runs"),
    ),
    PublishedClaim(
        "links", _RADIO,
        "Shadowing of 6 dB makes links as measured ones (motes in a building).",
        "It gives their grey zone from 70 % of frames upward; further down theirs fall off 2.5 dB sooner.",
        command="acrc bench radio --out",
    ),
    PublishedClaim(
        "localisation", _NAVIGATION,
        "The robot's localisation is as good as the original amcl, and keeps track among up to ten others.",
        "Over twelve courses with ten runs each the error of localisation `chapter` is 0.69 times amcl's "
        "(0.65 to 0.73), at most 0.80 times; neither loses any of 120 runs (`--from DIR --against JSON`). "
        "Localisation error, rmse: 0.024 to 0.747 m with `chapter`, 0.013 to 0.039 m with `robust`.",
        "benchmarks.localisation.command",
        small={"cell": _CORNERS, "runs": 1, "duration": 60.0}, full={"runs": 20}, seconds=(5, 540),
        takes=("source", "against", "runs", "cell", "duration", "log", "seed", "workers"),
    ),
    PublishedClaim(
        "navigation", _NAVIGATION,
        "Navigation `chapter` decides as the original's; robots reach random goals and touch no wall.",
        "Beside the compiled original: the same velocity in 99.0 % of 1280 cycles, within one sample in "
        "99.8 %, the same 75 plans (`--from DIR`, [what differs](navigation.md#against-the-original)). On "
        "three maps a robot alone with navigation `robust` reaches 240 of 240 goals; no wall is touched.",
        "benchmarks.navigation.navigation",
        small={"robots": (1,), "goals": 2, "runs": 1, "navigation": "robust"},
        full={"goals": 80, "runs": 20, "navigation": "robust"}, seconds=(8, 1200),
        takes=(
            *("maps", "robots", "goals", "runs", "localisation", "navigation", "setting"),
            *("log", "seed", "source"),
        ),
    ),
    PublishedClaim(
        "failures", _NAVIGATION,
        "The chapter's failures come about by themselves.",
        "Deadlocks and obstructed robots do; *lost* does not, with the chapter's sensor, odometry and map.",
        "benchmarks.failures.failures", small={"robots": (4,), "runs": 1, "duration": 200.0},
        full={"runs": 20}, seconds=(10, 900),
        takes=("scenario", "robots", "runs", "duration", "strategy", "localisation", "navigation"),
    ),
    PublishedClaim(
        "wedged", _NAVIGATION,
        "A robot with `back_off` gets free of another one that it is wedged with, head-on.",
        "All of 40 pairs come free, in a passage and on open floor "
        "([and what it does not cure](navigation.md#the-three-failures)).",
        "benchmarks.causes.wedge", small={"runs": 1}, full={"runs": 5}, seconds=(10, 60), takes=("runs",),
    ),
    PublishedClaim(
        "endings", _ENDS,
        "Whatever ends a run, nothing is left behind, and the recordings are good.",
        "200 runs killed, stopped or signalled at random instants: all ended or went on as they should, none "
        "hung.",
        "benchmarks.swarm.endings", small={"runs": 3, "longest_stop": 5.0}, full={"runs": 200},
        seconds=(35, 2400), takes=("runs", "seed", "workers"),
    ),
    PublishedClaim(
        "crowded-start", _ENDS,
        "A busy computer makes a run slow, and nothing else.",
        "A hundred robots beside four computing processes per core: one digest, nothing undelivered.",
        "benchmarks.swarm.crowded_start", small={"robots": 4, "hogs_per_core": 1}, full={"robots": 100},
        seconds=(20, 120),
    ),
    PublishedClaim(
        "resume", _ENDS,
        "A campaign that is killed resumes without a trace.",
        "Killed ten times at random moments: the same records as without, no trial made twice.",
        "benchmarks.swarm.resume", small={"runs": 2, "duration": 3.0}, full={"runs": 10}, seconds=(25, 300),
        takes=("runs", "duration"),
    ),
    PublishedClaim(
        "branches", _ENDS,
        "A branch without a change has the run's digest; one without a frame first differs by that frame.",
        "20 of 20 each ([observe and replay](observe-and-replay.md)).",
        "benchmarks.branches.forks", small={"runs": 2, "duration": 10.0}, full={"runs": 20},
        seconds=(5, 180),
        takes=("runs", "duration", "seed"),
    ),
    PublishedClaim(
        "causes", _ENDS,
        "The accounting of lost time names causes that are there, and invents none.",
        "197 of 200 planted causes are named, with queues, jams and doors (95.7 to 99.5 %), and 16 of 16 "
        "pauses on purpose; in 200 quiet situations nothing was invented (0 to 1.9 %).",
        "benchmarks.causes.causes", small={"runs": 13}, full={"runs": 200}, seconds=(25, 900),
        takes=("runs", "seed"),
    ),
    PublishedClaim(
        "verdicts", _ENDS,
        "`acrc compare` claims a difference that is not there in 6 of 100 campaigns at most; its intervals "
        "of A12 hold.",
        "1.5 to 4.3 % of 5000 campaigns each, drawn from a real one, after all runs or with looks on the "
        "way, also where runs fail. From six pairs on, A12 from 0.5 to 0.99, intervals hold 94 % or more, "
        "and 98 % or more of the real runs, with their ties and ceilings.",
        "benchmarks.verdicts.verdicts", small={"runs": 100, "draws": 1000, "campaigns": 100},
        full={"runs": 5000, "draws": 4000, "campaigns": 300}, seconds=(15, 360),
        takes=("runs", "seed"),
    ),
    PublishedClaim(
        "places", _ENDS,
        "No place is lost by the shipped strategies.",
        "A proof and its test ([strategies](strategies.md#why-no-place-is-lost)); a robot that is killed "
        "keeps what it holds.",
        command="acrc campaign",
    ),
    PublishedClaim(
        "seal", _ENDS,
        "A file of a run that was changed is named.",
        "Flipped bits, files removed, added, renamed or replaced by links: each is named "
        "([seal](observe-and-replay.md#what-a-run-leaves)).",
        "benchmarks.recordings.seals", small={"runs": 10}, full={"runs": 200}, seconds=(3, 60),
        takes=("runs", "seed"),
    ),
    PublishedClaim(
        "boards", _BOARD,
        "The drivers of base and radio board survive a noisy line, and the latter fills its line or the air.",
        "10 MB of noise and talk each: no packet reported twice, never or falsely; back within 100 ms.",
        "benchmarks.hardware.boards", small={"size": 100_000}, full={"size": 10_000_000}, seconds=(8, 900),
        takes=("size", "seed"),
    ),
    PublishedClaim(
        "onboard", _BOARD,
        "Processes as on board need no network between robots, and their recordings replay.",
        "Three robots, each process in a network namespace of its own: they clean all nine places.",
        "benchmarks.hardware.onboard", small={"robots": 2, "duration": 15.0}, full={"robots": 3},
        seconds=(25, 120), takes=("duration",),
    ),
    PublishedClaim(
        "bundle", _BOARD,
        "A robot needs no network, neither to be installed nor to drive.",
        "On a bare Debian 12, x86-64 and emulated aarch64, a bundle installs, and its robot drives emulated "
        "devices; its recording replays on x86-64 ([bundle](deployment.md#without-a-network)).",
        "benchmarks.hardware.bundled", small={"duration": 5.0, "only": ("x86-64",)}, full={"duration": 60.0},
        seconds=(180, 1800), takes=("duration", "only", "install"),
    ),
    PublishedClaim(
        "standstill", _BOARD,
        "The base stands when a process fails.",
        "Told to stand within 0.3 s and 0.15 m, whatever fails ([table](deployment.md#what-stops-it)).",
        "benchmarks.hardware.standstill", small={"trials": 1, "cases": _FEW_CASES}, full={"trials": 3},
        seconds=(30, 1200), takes=("trials",),
    ),
    PublishedClaim(
        "sensors", _BOARD,
        "The base stands when a sensor lies.",
        "Lies are named; those that are not noticed are listed ([table](deployment.md#sensors-that-lie)).",
        "benchmarks.hardware.sensor_trials", small={"trials": 1, "hours": 0.02},
        full={"trials": 20, "hours": 2.0}, seconds=(20, 3600), takes=("trials", "hours"),
    ),
)  # fmt: skip
