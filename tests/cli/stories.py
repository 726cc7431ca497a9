"""The stories that together call every option of every command, by name."""

from tests.cli.story import CTRL_C, Line

HEAD_ON = "scenarios/head_on.toml --seed 3"
STORIES: dict[str, tuple[Line, ...]] = {
    "root": (
        Line("--version", r"^acrc \S+, commit \S+"),
        Line("--install-completion bash", r"completion installed", ".bash_completions/acrc.sh"),
        Line("--show-completion bash", r"_ACRC_COMPLETE=complete_bash"),
    ),
    "lists": tuple(
        Line(f"list {what} --json", rf'"name": ?"{name}"')
        for what, name in (
            ("strategies", "chapter"),
            ("presets", "robust"),
            ("models", "turtlebot2"),
            ("scenarios", "head_on"),
            ("maps", "corridor"),
        )
    ),
    "run": (
        Line(
            f"run {HEAD_ON} --duration 3 --step 50 --strategy mine:behaviour --speed max --bus zenoh "
            "--spawn exec --no-isolate --limit memory_mb=1500 --timeout 50 --log r1 --out runs/a --modules . "
            f"--key {'0f' * 16} --check --json",
            r"checked: 4 actors replayed.*messages equal",
        ),
        Line(
            "run --robots 2 --navigation chapter --set run.duration=1.5 --isolate --out runs/b --trust",
            r"2 robots with strategy chapter and navigation chapter",
        ),
        Line(
            "branch runs/a@1 --event 'kill r2 at 1.5' --out runs/branch --trust",
            r"r2",
            "runs/branch/run.json",
        ),
        Line(
            "branch runs/a@1 --strategy chapter --set strategy.reach=0.6 --out runs/c2 --modules . --json",
            r'"digest"',
        ),
        Line(
            f"run {HEAD_ON} --duration 3 --strategy tests.debugging.stopping:behaviour --debug r1 "
            "--modules {root} --out runs/debug",
            r"stopping\.py[\s\S]*\(Pdb\) ",
            typed="c\n",
        ),
        Line(
            f"run {HEAD_ON} --duration 2 --speed 20 --control --out runs/c",
            r"the map page is http://",
            needs="websockets",
        ),
    ),
    "demo": (Line("demo --out d --json", r'"pictures":\["\S+/d/demo\.png"', "d/demo.png"),),
    "loop": (
        Line(
            "run near.toml --hardware-in-the-loop --board r1 --duration 4 --out runs/loop",
            "",
            "runs/loop/result/run.json",
        ),
        Line(
            "fleet collect runs/loop/r1 runs/loop/r2 --truth runs/loop/laboratory/result.json --out all "
            "--json",
            r'"places_done": ?\d',
            "all/places.csv",
        ),
    ),
    "looks": (
        Line(f"run {HEAD_ON} --duration 4 --strategy mine:behaviour --out runs/a", "", "runs/a/run.json"),
        Line(f"run {HEAD_ON} --duration 4 --strategy none --out runs/b", "", "runs/b/run.json"),
        Line("view runs/a --png --svg --html page.html", r"runs/a/run.png", "page.html"),
        Line("view runs/a --json", r'"stands":"ended","files":\[\]'),
        Line("view runs/a --movie a.gif --speed 100", r"a.gif", "a.gif"),
        Line("view runs/a --beside runs/b --png", r"beside.png", "runs/a/beside.png"),
        Line(
            "scenario scenarios/head_on.toml --robots 2 --seed 4 --set run.duration=5.0 --png plan.png",
            "2 robots",
            "plan.png",
        ),
        Line("scenario own.toml --modules .", r"mine:behaviour"),
        Line("scenario scenarios/head_on.toml --json", r'^\{"is":"scenario","robots":2,'),
        Line("scenario own.toml --trust", r"mine:behaviour"),
        Line("replay runs/a --modules .", r"^identical: \d+ messages; digest"),
        Line("replay runs/a --robot r1 --to 2 --trust", r"^r1: identical: \d+ outputs up to 2 s"),
        Line("replay runs/a --robot r1 --trust --json", r'^\{"actor":"r1","outputs":\d+,"whole":true\}'),
        Line("replay runs/a --robot r1 --strategy none --trust", r"r1"),
        Line("replay runs/a --robot r1 --from 1 --pdb --trust", r"\(Pdb\)", typed="c\n"),
        Line(
            "replay runs/a --robot r1 --from 1 --debugpy 5678 --trust",
            r"^an editor may attach at 5678\nit does\n(?:.*\n)*it stops$",
        ),
        Line("explain runs/a r1 --json --modules . --trust", r"^\["),
        Line("record echo runs/a */log --follow", r"step 30  r[12] looks"),
        Line(
            "export runs/a --out tables --modules . --trust --json",
            r'"tables/poses.parquet","rows":\d',
            "tables/poses.parquet",
        ),
        Line("export runs/a --mcap ros2 --robot r1 --trust", r"messages of \d+ topics", "runs/a.ros2.mcap"),
        Line("record check runs/a --json", r'^\{"digest":"'),
        Line("replay runs/a --robot r1 --modules . --isolate", r"^r1: identical: \d+ outputs$"),
        Line("replay runs/a --robot r2 --no-isolate --trust", r"^r2: identical: \d+ outputs$"),
        Line("record echo runs/a r1/drive --csv --follow --from 1", r"^2\.9,r1/drive,29,"),
        Line("record echo runs/a truth --json --to 1", r'^\{"seconds": 1\.0'),
        Line("record info runs/a r1/drive --follow --from 1 --to 2 --json", r'"r1/drive"'),
        Line("record plot runs/a r1/drive vx --from 1 --to 2 --out vx.png --json", r'"vx.png"', "vx.png"),
        Line("causes runs/a --json", r'"r1"'),
        Line("causes runs/a --what-if --modules . --trust", r"nothing that was ordered kept the robots"),
        Line("report runs/a --out page --json", r'^\{"page":"page/report.html"', "page/report.html"),
        Line("order runs/a pause --json", r"no run is going on", codes=(1,)),
    ),
    "viewer": (
        Line(
            f"run {HEAD_ON} --duration 2 --strategy mine:behaviour --view --robot r1 --out runs/v",
            r"",
            "runs/v/view.rrd",
            needs="rerun",
        ),
        Line("view runs/v --robot r1 --why --trust --isolate --save v.rrd", r"", "v.rrd", needs="rerun"),
        Line(  # beside: in a new interpreter; in a fork of one that has imported the viewer it hangs
            "view runs/v --why --modules . --no-isolate --screenshot v.png --at 1",
            r"v\.png",
            "v.png",
            beside=True,
            needs="rerun",
        ),
    ),
    "campaign": (
        Line(
            "campaign --scenario scenarios/head_on.toml --strategies none,chapter --seeds 4 --robots 2 "
            "--duration 1 --set run.step_ms=100 --tuning --check-every 0 --jobs 1 --out campaigns/a --json",
            r'"none"',
        ),
        Line(
            "compare campaigns/a --metric radio --json",
            r'"too_few": ?\["[^"]*none[^"]*4 pairs of runs are too few',
        ),
        Line("bundle campaigns/a --out a.zip --author 'Ada Lovelace' --json", r'^\{"file":"a.zip"', "a.zip"),
        Line("study plan --pilot campaigns/a --metric radio", r"pairs"),
        Line(  # refused where sources have been changed
            "study freeze studies/drawn_places.toml --until-decided --out plan.json --json",
            r'^\{"file":"plan.json"|must be committed before a plan is frozen',
            codes=(0, 1),
        ),
        Line(
            "campaign --strategies none --seeds 1 --duration 1 --plan study.toml --out campaigns/p",
            r"study.toml: no frozen plan",
            codes=(1,),
        ),
        Line("study plan --a12 0.8 --power 0.8 --correlation 0.5 --comparisons 2 --json", r'^\{"pairs":\d+'),
        Line(
            "campaign --preset chapter --seeds 1 --robots 2 --duration 1 --check-every 0 --until-decided "
            "--out campaigns/b",
            r"none",
        ),
        Line(
            "campaign study.toml --modules . --isolate --jobs 1 --check-every 0 --out campaigns/mine",
            r"mine:behaviour",
        ),
        Line("campaign study.toml --trust --jobs 1 --check-every 0 --out campaigns/again", r"mine:behaviour"),
    ),
    "cluster": (
        Line("cluster start here", r"ADDRESS: here; must be the address of a scheduler", codes=(2,)),
        Line("cluster join here --workers 2", r"ADDRESS: here; must be the address", codes=(2,)),
        Line(
            "campaign --scenario scenarios/head_on.toml --strategies none --seeds 1 --duration 1 "
            "--check-every 0 --on {cluster} --out campaigns/c",
            r"none",
        ),
        Line(
            f"run {HEAD_ON} --duration 2 --on {{cluster}} --listen 127.0.0.1 --out runs/hosted --json",
            r"hosts: \S+ \(\d+ cores?\): r1 and r2; they connect to 127\.0\.0\.1:\d+",
            "runs/hosted/r2/r2.mcap",
        ),
        Line(
            f"run {HEAD_ON} --duration 2 --on {{cluster}} --listen 127.0.0.1 --leave --out runs/left",
            r"runs/left/r1/r1\.mcap and 1 more is still on host \S+; `\S+ cluster fetch",
        ),
        Line(
            "cluster fetch runs/left --on {cluster} --json",
            r'"files":2,"bytes":\d+',
            "runs/left/r2/r2.mcap",
        ),
    ),
    "docs": (Line("docs --out site --open", r"site/index.html", "site/index.html"),),
    "verify floors": (
        Line("verify --list --json", r'"name": "seal"'),
        Line("verify radio --data rows --runs 1 --json", r'"points": 1\b'),
        Line("verify radio seal", r"seal\s*│ holds"),
        Line(
            "verify branches seal causes --runs 1 --seed 2 --duration 2 --json",
            r'"branches": \{"holds": true',
        ),
        Line("verify mutations boards --bytes 1000 --seed 2 --json", r'"mutations": \{"holds": true'),
    ),
    "verify ends": (
        Line("verify failures navigation", r"failures\s*│ holds"),
        Line("verify radio functions seal boards", r"boards\s*│ holds"),
        Line("verify container", r"acrc\.def: read, \d steps from debian:bookworm-slim on"),
        Line("verify attacks --full --json", r'"outcome": "held"'),
        Line("verify same-bits", r"same-bits: holds"),
        Line("verify causes wedged mutations branches", r"mutations\s*│ holds"),
        Line("verify endings --runs 1 --seed 2 --workers 1 --json", r'"not as due": 0'),
        Line("verify resume --runs 1 --duration 1 --json", r'"kill": 1'),
        Line("verify crowded-start --json", r'"processes, busy computer"'),
    ),
    "verify driving": (
        Line(
            "verify navigation --map maps/corridor.yaml --robots 1 --goals 1 --runs 1 --localisation robust "
            "--set dwa.max_speed=0.4 "
            "--navigation robust --json",
            r"corridor",
        ),
        Line("verify navigation --from {root}/tests/navigation/original --json", r'"within_one": 1\.0'),
        Line("verify navigation --log n.zip --seed 2 --robots 1 --goals 8", r"n.zip", "n.zip"),
        Line(
            "verify failures --scenario scenarios/head_on.toml --robots 2 --runs 1 --duration 1 "
            "--strategy none --localisation robust --navigation robust --json",
            r'"robots"',
            codes=(1,),
        ),
    ),
    "verify localisation": (
        Line("verify localisation --log l.zip --seed 2 --cell tracking --duration 2", r"l.zip", "l.zip"),
        Line(
            "verify localisation --from l.zip --runs 1 --against theirs.json --json",
            r'"against"',
            codes=(0, 1),
        ),
        Line("verify localisation --cell kidnapped --runs 1 --duration 20 --workers 1 --json", r"kidnapped"),
        Line("verify localisation", r"localisation: holds"),
    ),
    "verify robots": (
        Line("verify onboard --duration 10 --json", r'"executed_again"', codes=(0, 1)),
        Line("verify standstill", r"told, median", codes=(0, 1)),
        Line("verify sensors --trials 1 --hours 0.01 --json", r'"calm": \[\{'),
        Line("verify processors --duration 1 --install --only AVX2 --json", r"crowd"),
        Line("verify bundle --duration 5 --only x86-64 --json", r'"replayed": [1-9]|"missing": "[^"]'),
    ),
    "bench": (
        Line("bench", r"^functions   elementary functions"),
        Line(
            "bench radio --out figures --data rows --map maps/corridor.yaml --json",
            r'"reference": true',
            "figures/contention.svg",
        ),
        Line("bench radio --json", r'"firmware":'),
        Line("bench world --map maps/maze.yaml --json", r'"scan_us"'),
        Line("bench deeco --json", r'"robot_second_cpu_ms"'),
        Line("bench functions --json", r'"hypot"'),
    ),
    "bench swarms": (
        Line("bench swarm --robots 1 --duration 2 --repeat 1 --json", r'"forkserver"'),
        Line("bench start --robots 1 --repeat 1 --json", r'"first step"'),
        Line("bench hosts --robots 3 --duration 1 --json", r'"steps_per_s"'),
        Line("bench recordings --robots 1 --duration 1 --json", r'"replayed"', codes=(0, 1)),
        Line(
            "bench relays --scenario scenarios/chapter.toml --robots 2 --below -80 --seeds 1 --seed 3 "
            "--duration 15 --json",
            r"-80",
        ),
        Line("bench budget --duration 3 --json", r'"voluntary"'),
        Line("bench budget --bus zenoh --write", r"--write: keeps counts in memory", codes=(2,)),
        Line(
            "bench beside {root} --scenario scenarios/head_on.toml --robots 2 --seed 3 --duration 1 "
            "--pairs 2 --bus memory --navigation robust --json",
            r'"digests_equal": true',
        ),
    ),
    # last, as the emulated devices compute from here to the end of the file
    "fleet": (
        Line(
            "fleet keys f.toml --out keys --host r1=127.0.0.1 --days 30 --json",
            r'"hosts":\["r1","r1.local","127.0.0.1"\]',
        ),
        Line(
            "fleet keys f.toml --host r1=127.0.0.1 --revoke r1",
            r"What r1 had is worth nothing",
            "keys/r1/key.pem",
        ),
        Line(
            "fleet units f.toml --robot r1 --user ada --modules . --out u --json",
            r'"rules":".*60-acrc.rules"',
            "u/acrc-r1.service",
        ),
        Line(  # with a network only
            "fleet bundle f.toml --robot r1 --machine aarch64 --python 3.12 --modules . --out b.tar --json",
            r'^\{"file":"b.tar","robot":"r1","machine":"aarch64"|aarch64 and Python 3.12 cannot be fetched',
            codes=(0, 1),
        ),
        Line("fleet doctor f.toml --robot r1 --modules . --json", r'^\{"robot":"r1"', codes=(0, 1)),
        Line(
            "fleet onboard f.toml --robot r1 --out runs/one --isolate --at start --modules .",
            r"r1 is running",
            beside=True,
        ),
        Line("fleet watch {listen} --keys keys/operator", r"places left", typed=CTRL_C, codes=(130,)),
        Line(
            "fleet watch {listen} --keys keys/operator --view f.toml",
            r"places left",
            typed=CTRL_C,
            codes=(130,),
            needs="rerun",
        ),
        Line("fleet pause {listen} --keys keys/operator --json", r'"failure":null'),
        Line("fleet resume {listen} --keys keys/operator --json", r'"failure":null'),
        Line("fleet stop {listen} --keys keys/operator --json", r'"failure":null'),
    ),
    "told": (
        Line("fleet keys f.toml --host r1=127.0.0.1", r"All hold until"),
        Line(
            "fleet onboard f.toml --robot r1 --out runs/two --no-isolate --debugpy 5679 --at 12,13,0.5 "
            "--modules .",
            r"r1 is running",
            beside=True,
        ),
        Line("fleet watch {listen} --keys keys/operator", r"places left", typed=CTRL_C, codes=(130,)),
        Line("fleet stop {listen} --keys keys/operator", r"has stopped"),
        Line("record info runs/two", r"^r1\.base: \d+ messages"),
    ),
}
NIGHTLY = {"demo", "docs", "cluster", "bench swarms", "verify ends", "verify robots"}
"""What takes minutes, or is what another test does with the same words: run by `acrc test --nightly`."""
