"""What is run for the commands on the pages other than the tutorial.

They run in the folder in which the tutorial was typed, in the order of the tables. `TYPED` has what
is run for a line ("" is the line itself): the same command with a twin for the hardware, a smaller
device or less time, where needed after other commands (`&&`). `NOT_RUN` has the reasons for the
other lines.
"""

import re

_BLOCK = re.compile(r"^ *```sh\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
_REHEARSAL = "--board my-cameras --calibration rehearsal.toml"
_FILMED = "capture record my-device --cameras twin --port twin --rounds 1 --seconds 1 --free 1"
_LIVE = "run my-device/model.json --port twin --seconds 3 --json"

TYPED = {
    "assembly": {
        "defsense build my-device": "",
        "defsense build my-device --bed 250,210,210 --copies 3":
            "defsense build my-joystick --bed 250,210,210 --copies 3",
        "defsense open my-device --guide": "",
    },
    "boards": {
        "defsense board wiring my-device --board esp32 --converter ads1115 --out my-wiring": "",
    },
    "calibration": {
        "defsense calibrate specimen my-specimen": "",
        "defsense calibrate record --port twin:speed=20 --specimen my-specimen --rounds 2":
            "defsense calibrate record --port twin:speed=100 --specimen my-specimen --rounds 1"
            " --auto",
        "defsense calibrate fit my-specimen/session": "",
        "defsense calibrate fit readings.csv --thickness 15 --offset 2": "",
    },
    "cameras": {
        "defsense capture camera calibrate twin --board my-cameras --calibration rehearsal.toml":
            f"defsense capture camera calibrate twin {_REHEARSAL} --views 12",
        "defsense capture camera arrange twin --board my-cameras --calibration rehearsal.toml":
            f"defsense capture camera arrange twin {_REHEARSAL} --views 8",
        "defsense capture camera check twin --board my-cameras --calibration rehearsal.toml": "",
    },
    "capture": {
        "defsense capture record my-device --cameras 0 2 --port /dev/ttyUSB0":
            f"defsense {_FILMED} --rest 1 --video --auto --out filmed",
        "defsense capture process --videos a.mkv b.mkv --calibration cameras.toml --tag-size 15"
        " --dictionary 4X4_50 --out tracks.csv":
            "defsense capture process --videos filmed/run-1/cam_0.mkv filmed/run-1/cam_1.mkv"
            " --calibration filmed/cameras.toml --tag-size 10 --dictionary 4X4_50 --out tracks.csv",
    },
    "casting": {
        "defsense build my-device": "",
    },
    "check-wiring": {
        "defsense board check my-device --port twin:unit=2,swap=A+B --auto":
            "defsense board check my-joystick --port twin:unit=2 --auto",
    },
    "clearance": {
        "defsense calibrate coupon my-coupon --cord rubber-2mm --process fdm-tpu": "",
        "defsense calibrate clearance my-device --fits 0.3":
            "defsense calibrate clearance my-joystick --fits 0.3",
    },
    "evaluation": {
        "defsense evaluate my-device/model.json my-device/session-2":
            "defsense evaluate my-device/model.json session",
        "defsense evaluate model.json session --against affine.json --last-share 0.3":
            "defsense recalibrate my-device/model.json session && defsense evaluate"
            " my-device/model.json session --against my-device/recalibrated.json",
        "defsense evaluate model.json --signals signals.csv --tracks take.c3d --device my-device":
            "defsense twin my-device --minutes 0.3 --cameras webcam --out seen"
            " && defsense train seen --device my-device --out seen.json"
            " && defsense capture convert seen/aligned.csv take.c3d && defsense evaluate seen.json"
            " --signals seen/signals.csv --tracks take.c3d --device my-device",
    },
    "flash-arduino": {
        "defsense board ports": "",
    },
    "live": {
        "defsense run my-device/model.json --port /dev/ttyUSB0 --view": f"defsense {_LIVE} --view",
        "defsense new demo --body bar": "",
        "defsense twin demo --out demo/session":
            "defsense twin my-device --minutes 1 --out my-device/session",
        "defsense train demo/session --device demo":
            "defsense train my-device/session --device my-device",
        "defsense run demo/model.json --port twin --view": f"defsense {_LIVE} --view",
        "defsense run my-device/model.json --port replay:my-device/session --view":
            "defsense run my-device/model.json --port replay:session --seconds 3 --json",
        "defsense run my-device/model.json --port"
        " replay:my-device/live/2026-11-25-14-03-09/board.csv --view":
            "defsense run my-device/model.json --port replay:my-device/live/*/board.csv --view"
            " --seconds 3 --json",
        "defsense run a/model.json b/model.json --port /dev/ttyUSB0 /dev/ttyUSB1 --view":
            "defsense run my-device/model.json my-joystick/model.json --port twin twin"
            " --seconds 3 --json",
        "defsense run my-device/model.json --port twin:seed=7,cut=A@20-30":
            "defsense run my-device/model.json --port twin:seed=7,cut=A@1-2 --seconds 3"
            " --json",
    },
    "live-outputs": {
        "defsense run my-device/model.json --port /dev/ttyUSB0 --output osc,port=9000"
        " --output websocket":
            f"defsense {_LIVE} --output osc,port=9000 --output websocket,port=0",
    },
    "live-programs": {
        "defsense run my-device/model.json --port /dev/ttyUSB0"
        " --output 'osc,send=[\"controls\",\"markers\"]'":
            f"defsense {_LIVE} --output 'osc,send=[\"controls\",\"markers\"]'",
        "defsense run my-device/model.json --port /dev/ttyUSB0 --output websocket":
            f"defsense {_LIVE} --output websocket,port=0",
    },
    "live-recording": {
        "defsense run my-device/model.json --port /dev/ttyUSB0 --animation bend.glb":
            f"defsense {_LIVE} --animation bend.glb",
    },
    "machine": {
        "defsense doctor": "",
        "defsense list materials": "",
        "defsense list printers fdm-tpu": "",
        "defsense completion bash": "",
        "defsense open my-device": "",
        "defsense open my-device --guide": "",
        "defsense completion bash > ~/.local/share/bash-completion/completions/defsense":
            "defsense completion bash",
    },
    "measure-filament": {
        "defsense calibrate trace-coupon my-traces --trace eel": "",
        "defsense calibrate resistivity my-traces --ohm 7710,2600,3870,1550,1600,4930,3310": "",
        "defsense calibrate specimen my-specimen --trace eel":
            "defsense calibrate specimen my-traced-specimen --trace eel",
    },
    "motion-capture": {
        "defsense capture markers my-device": "defsense capture markers my-device --out my-markers",
        "defsense capture convert take.c3d tracks.csv":
            "defsense capture convert fixtures/c3d/vicon_jump.c3d jump.csv",
    },
    "new": {
        "defsense new my-device": "defsense new another-device --body bar",
        "defsense build my-device": "",
        "defsense open my-device": "",
    },
    "own-sensor": {
        "defsense train --signals walk-1.csv walk-2.csv --targets knee-1.csv knee-2.csv"
        " --out model.json": "",
        "defsense evaluate model.json --signals walk-1.csv walk-2.csv"
        " --targets knee-1.csv knee-2.csv": "",
        "defsense run model.json --port replay:walk-2.csv --output osc,port=9000 --record run-1":
            "defsense run model.json --port replay:walk-2.csv --output osc,port=9000"
            " --record run-1 --seconds 3 --json",
        "my-reader | defsense run model.json --port stdin --json":
            "sh -c 'cat walk-2.csv | defsense run model.json --port stdin --json'",
    },
    "printed": {
        "defsense build my-device": "",
    },
    "printed-model": {
        "defsense twin DIR --unit 1 --seed 11 --out session":
            "defsense twin my-device --unit 1 --seed 11 --minutes 1 --out printed",
        "defsense train session --device DIR --json":
            "defsense train printed --device my-device --out printed.json --json",
    },
    "study": {
        "defsense study my-device --sensors 1..6": "defsense study my-joystick --sensors 1..2",
        "defsense study my-device": "",
    },
    "tags": {
        "defsense build my-device": "",
        "defsense capture markers my-device --side 0,-1,1": "",
        "defsense capture board my-cameras": "",
        "defsense capture board my-cameras --measured 29.95": "",
    },
    "training": {
        "defsense train my-device/session --device my-device":
            "defsense train session --device my-device",
        "defsense recalibrate my-device/model.json routine":
            "defsense recalibrate my-device/model.json session",
    },
    "training-data": {
        "defsense dataset my-device/session --device my-device --out my-device/data":
            "defsense dataset session --device my-device --out my-device/data",
        "defsense dataset my-device/session --lerobot policy-data --rate 30":
            "defsense dataset session --lerobot policy-data --rate 30",
    },
    "twin": {
        "defsense build my-device": "",
        "defsense twin my-device": "defsense twin my-device --minutes 1",
        "defsense train my-device/twin-1-1 --device my-device": "",
        "defsense capture markers my-device --side 0,-1,1": "",
        "defsense twin my-device --list-assumptions": "",
        "defsense twin my-device --minutes 5 --cameras webcam --out my-device/filmed":
            "defsense twin my-device --minutes 0.2 --cameras webcam --out my-device/filmed",
        "defsense capture record my-device --cameras twin --port twin":
            f"defsense {_FILMED} --rest 1 --auto --out filmed-again",
        "defsense twin my-device --off relaxation,hysteresis,mullins --out my-device/plain":
            "defsense twin my-device --off relaxation,hysteresis,mullins --minutes 1"
            " --out my-device/plain",
        "defsense train my-device/plain --device my-device --out my-device/plain.json": "",
    },
    "wifi-board": {
        "defsense board micropython my-board": "",
    },
}  # fmt: skip

_CAMERAS = "needs cameras; the same with twin is run"
_BOARD = "needs a read-out board"
NOT_RUN = {
    "cameras": {
        "defsense capture camera calibrate 0 2 --board my-cameras --name left right": _CAMERAS,
        "defsense capture camera arrange 0 2 --board my-cameras": _CAMERAS,
        "defsense capture camera check 0 2 --board my-cameras": _CAMERAS,
    },
    "capture": {
        "defsense capture process my-device/session":
            "needs minutes of recorded cameras; tests/capture/sessions processes one",
    },
    "check-wiring": {
        "defsense board check my-device --port /dev/ttyUSB0": _BOARD,
    },
    "cluster": {
        "pip install 'defsense_fab-0.1.0-cp311-abi3-linux_x86_64.whl[cluster]'": "needs a network",
        "dask scheduler":
            "serves until it is stopped; tests/workflow/study/test_parameter_study starts one",
        "dask worker tcp://192.168.1.10:8786 --nthreads 1": "needs another machine",
        "defsense study my-device --scheduler tcp://192.168.1.10:8786": "needs another machine",
    },
    "contributing/release": {
        "git clone defsense-fab release && cd release": "needs the address of the repository",
        "python3.11 -m pip install build": "needs a network",
        "python3.11 -m build": "needs a network",
    },
    "flash-arduino": {
        "defsense board flash my-device": "needs an Arduino; tests/firmware/test_flash has one",
        "defsense board flash --board uno --converter ads1115": "as above",
    },
    "guide/install": {
        "python3 -m venv defsense-env": "the tests run in an environment that CI makes so",
        "defsense-env/bin/pip install defsense_fab-*.whl": "needs a network",
        "defsense-env/bin/defsense doctor": "run as `defsense doctor`",
        "pip install --no-deps -r requirements.lock": "needs a network",
        "pip install --no-deps defsense_fab-*.whl": "needs a network",
    },
    "live": {
        "defsense build demo": "the same as for a smaller device, in two minutes",
    },
    "live-messages": {
        "sudo modprobe uinput": "needs an administrator",
        "sudo setfacl -m u:$USER:rw /dev/uinput": "needs an administrator",
    },
    "live-programs": {
        "defsense run my-device/model.json --port /dev/ttyUSB0 --output midi,virtual=DefSense":
            "needs a driver for MIDI; tests/runtime/outputs/test_midi_output has a cable",
        "defsense run my-device/model.json --port /dev/ttyUSB0"
        " --output 'midi,virtual=DefSense,mapping=[{control=\"bend\",cc=20}]'": "as above",
    },
    "machine": {
        "defsense cache clear": "other tests use the cache; tests/cli/help/test_cache clears one",
        "mkdir -p ~/.local/share/bash-completion/completions": "changes the home folder",
    },
    "measure-filament": {
        "defsense traces my-traces my-traces.gcode": "needs the project of a slicer",
    },
    "motion-capture": {
        "defsense capture record my-device --cameras none --port /dev/ttyUSB0": _BOARD,
        "defsense capture process my-device/session --tracks take.c3d":
            "needs a motion capture system",
    },
    "printed": {
        "prusa-slicer --load two-extruders.ini --export-gcode --dont-arrange --output arm.gcode"
        " prusaslicer.3mf": "needs the project of a slicer",
        "defsense traces my-device arm.gcode": "as above",
    },
    "reproduce": {
        "defsense reproduce --quick": "many minutes; tests/workflow/reproduce runs a smaller one",
        "defsense reproduce bar": "hours",
        "defsense reproduce": "hours",
        "defsense run reproduced/bar/full/unit-1.json --device reproduced/bar/full --port twin":
            "as above",
        "defsense reproduce my-device --units 3": "as above",
    },
    "studio": {
        "defsense studio my-device": "serves until it is stopped; tests/studio starts it",
    },
    "training": {
        "defsense capture record my-device --cameras none --port /dev/ttyUSB0 --rounds 3"
        " --seconds 5 --free 0 --rest 5 --out routine": _BOARD,
    },
    "wifi-board": {
        "defsense board pair --port /dev/ttyACM0 --name elbow": _BOARD,
        "defsense board ports --port udp://elbow": _BOARD,
        "defsense run my-device/model.json --port udp://elbow --view": _BOARD,
    },
}  # fmt: skip


def lines_of(text):
    """Return the lines of a page's shell blocks, with continued lines joined."""
    lines = "".join(_BLOCK.findall(text)).replace("\\\n", " ").splitlines()
    return [" ".join(line.split()) for line in lines if line.strip()]
