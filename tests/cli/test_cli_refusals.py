"""Invalid arguments of all commands.

Each line of `REFUSED` ends with code 2, prints its words (in one line or below the usage), and changes no
file.
"""

import shlex
import shutil

import pytest
from experiments import write_design
from project import MESHES
from sealed_frames import sealed

SCENE = """
[service]
publish = "mailbox:a"
real_time = false
[[parts]]
file = "box.stl"
[input]
recording = "hand.csv"
"""
SENSOR = '[input]\nsensor = "mailbox:sensor"\n'
REFUSED = """
query box.stl 1 2 | a point is three numbers, but 2 were given
query box.stl 1 2 nan | 'nan' is not finite, expected a number
query box.stl 1 -inf 3 | '-inf' is not finite, expected a number
query box.stl 1 1e400 3 | '1e400' is beyond 1.8e+308, the largest number
query box.stl 1 2 3 --ray 0 nan 1 | 'nan' is not finite, expected a number
query box.stl 1,2,3 | '1,2,3' is not a number; separate numbers by spaces only: 1 2 3
query box.stl 1,5 2 3 | '1,5' has a decimal comma, expected a decimal point: 1.5
query box.stl --json | give a point, or --points FILE
query box.stl 1 2 3 --points - | points are given as arguments already
query box.stl 1 2 3 --segment | points are taken in pairs (start, end), but there are 1
query box.stl 1 2 3 --segment --ray 0 0 1 | give one of them, not both
query box.stl 1 2 3 --json --csv - | give one of them, not both
query box.stl 1 2 3 --all | is for --ray
query box.stl 1 2 3 --segment --min-distance 1 | is for --ray
query box.stl 1 2 3 --workers 0 | 0 threads: expected 1 or more, or -1
query box.stl 1 2 3 --workers two | Invalid value for '--workers'
query box.stl 1 2 3 --unpacked-limit 0 | 0: expected more than 0
query box.stl 1 2 3 --foo | No such option
query box.stl 1 2 3 -x | No such option
query 30 10 5 box.stl | is not a number; FILE comes first, before X Y Z
query none.stl --points bad.csv --json | bad.csv, line 1: 2 values, expected 3
query box.stl --points none.csv | none.csv: cannot be read (No such file or directory)
query none.stl 1 2 3 | none.stl: there is no such file
check none.stl | none.stl: there is no such file
query box.stl --points junk.stl | junk.stl: its header claims
query box.stl --points junk.obj | junk.obj: line 1
query box.stl --points none.ply | none.ply: there is no such file
query box.stl 1 2 3 --report page.html | requires --points and --within
query box.stl --points points.csv --report page.html | requires --points and --within
query box.stl 1 2 3 --points-units m | is for --points
compile part.stl --out part.prox | part.stl: it has 8 bytes
compile box.stl box.stl | expected the file to write
compile box.stl --out part.stl | part.stl does not end in .prox
compile box.stl --out none/box.prox | none/box.prox: cannot be written (No such file or directory)
picture box.stl -o box.jpg | box.jpg does not end in .png
picture box.stl -o box.png --size wide | 'wide': expected width and height, for example 1400x800
picture box.stl -o box.png --slice 3 | '3': expected an axis and a position, for example z=3
picture box.stl -o box.png --slice z=nan | 'nan' is not finite
picture box.stl -o box.png --points none.csv | none.csv
picture box.stl | Missing option
clearance cell.glb a b c | 3 names are given, expected two at most
clearance cell.glb base lid --all | two parts are one pair
clearance cell.glb bolt | no part is named 'bolt'; the scene has 'pin_left', 'pin_right', 'base', 'lid'
clearance cell.glb bass | no part is named 'bass'; did you mean 'base'?
clearance cell.glb lid lid | 'lid' is asked how far it is from itself, expected two parts
clearance cell.glb --below -1 | expected 0 to
clearance cell.glb --ignore-touching | requires --below
clearance cell.glb --allow pairs.csv | requires --clashes or --below
clearance cell.glb --clashes --below 1 | not allowed with --clashes
clearance cell.glb --clashes --allow pairs.csv | line 3: no part is named 'lit'; did you mean 'lid'?
clearance cell.glb --below 1 --allow absent.csv | absent.csv: cannot be read
clearance cell.glb --below 1 --allow hand.csv | expected CSV with the columns first and second
simulate --speed -1 | -1 m/s: expected 0.01 to 10
simulate --rate 1 | 1 Hz: expected 5 to 50000
simulate --latency 2s | 2000 ms: expected 0 to 1000
serve bad.toml | bad.toml:6: parts[0].file is 'bax.stl', but
serve cell.toml --limit 0 | 0 seconds: expected
serve cell.toml --limit nan | nan seconds: expected
serve cell.toml --ticks 0 | 0 ticks: expected 1 or more
serve cell.toml --port 8787 | requires --web
serve cell.toml --rate 0 | service.rate_hz is 0, expected a number from 1 to 100000 (Hz)
serve cell.toml --rate nan | service.rate_hz is nan, expected a number from 1 to 100000 (Hz)
serve cell.toml --publish decaff | decaff: expected an address such as shm://
serve cell.toml --log none/run.frames | none/run.frames: cannot be opened (No such file or directory)
record iox9://a --out a.frames | iox9://a: no transport is called 'iox9'
record mailbox:a --out none/a.frames | none/a.frames: cannot be opened (No such file or directory)
record mailbox:a --out box.stl | box.stl: not a frame log, expected a file that begins with
record mailbox:a --out a.frames --limit 0 | 0 seconds: expected more than 0, up to 1e+09
record mailbox:a --out a.frames --limit nan | nan seconds: expected more than 0, up to 1e+09
export none.frames --csv a | none.frames: cannot be read (No such file or directory)
export hand.csv --csv a | hand.csv: no frame was found in its
export run.frames --csv none/a | none/a: cannot be written (No such file or directory)
export run.frames --csv ./run.frames | run.frames is the log itself
export run.frames --csv a --parquet b | expected one of --csv and --parquet
export run.frames --parquet - | Parquet is not written to standard output
watch decaff | decaff: expected an address such as shm://NAME
view box.stl --radius 0 | 0 mm: expected more than 0, up to 1000
view box.stl --port 70000 | 70000: expected 0 to 65535
view box.stl --contact 1 | requires --clashes
view box.stl --save a.rrd | a.rrd does not end in .html
demo --limit 0 | 0 seconds: expected more than 0, up to 1e+09
demo --limit nan | nan seconds: expected more than 0, up to 1e+09
drum mailbox:a --limit 1 --max-age 5 | requires --glove
drum mailbox:a --rate 100 | expected 150 to 5000
drum mailbox:a --rate nan | expected 150 to 5000
drum mailbox:a --arm | requires --motor
drum mailbox:a --limit 1 --log none/drum.csv | drum.csv: cannot be written (No such file or directory)
drum mailbox:a --glove none.json | none.json: cannot be read (No such file or directory)
client header --out none/x.h | x.h: cannot be written (No such file or directory)
client cpp --out file | file: is not a folder and cannot be created (File exists)
client rust --out new | No such command 'rust'
client wasm --out new | Did you mean 'library wasm'?
controller --out new --cable stiff | 'stiff': expected a stiffness in N/m
controller --out file | file: is not a folder and cannot be created (File exists)
controller --out new --rate 100 | 100 Hz: expected 150 to 20000
controller --out new --glove none.json | none.json
calibrate glove.json --drum gear5 | drum is 'gear5', expected one of gear14, gear51, gear111
calibrate glove.json --seed 3 | requires --simulate
calibrate glove.json --simulate --counts udp://127.0.0.1:1 | a simulated glove has its own counts
calibrate glove.json --skip 'pose 1' | 'pose 1': expected 'free drum' or 'held drum'
calibrate glove.json --simulate --motor canopen://can0 | a simulated glove has its own drum
calibrate glove.json --arm | requires --motor
calibrate glove.json --phalanges 45 -26 20 | one of phalanges is -0.026
bench none.stl | none.stl
bench sensor.toml | a scene without parts has no geometry
bench box.stl --gate soon | 'soon' is not a period, expected a time or a rate such as 1ms, 200us or 1kHz
bench box.stl --ticks 10 | 10 ticks are too few for p99.9, expected 1000 or more
bench box.stl --limit 0 | the loop cannot run for 0 s
bench box.stl --fingers 0 | 0 fingers cannot be tracked, expected 1 or more
bench box.stl --out cell.gif | cell.gif does not end in .json or .png, .svg, .pdf
bench box.stl --recording no.csv | no.csv
bench box.stl --seed -2 | -2 is not a seed
figures 5d 5z | no figure '5z', expected some of 5a, 5b, 5c, 5d, 5e, 5f, 5g, 5h
simulate --wall soft | 'soft': expected one of real, coupled, decaff
simulate --wall coupled --drum gear51 | a coupled wall has none
simulate --stiffness 5 | a decaff wall has none
simulate --wall coupled --stiffness 5 | expected both or neither
simulate --latency -3 | -3 ms: expected 0 to 1000
simulate --wall real --cable 1212 | a real wall has none
simulate --stretch torque | there is no --cable that stretches
simulate --scene box.stl --stretch torque | there is no --cable that stretches
simulate --cable 1212 --stretch much | 'much': expected one of left, torque, sensor
simulate --cable stiff | 'stiff': expected a stiffness in N/m, or the file of a calibration
simulate --cable 5 | 5 N/m at the fingertip: expected 10 to 1e+06
simulate --cable nan | nan N/m at the fingertip: expected 10 to 1e+06
simulate --cable box.stl | box.stl
simulate --part box | requires --scene FILE
simulate --scene box.stl --wall real | must be decaff on a part of a scene
simulate --scene box.stl --damping 2 | requires --stiffness on a part
simulate --scene box.stl --part lid | lid
simulate --scene none.stl | none.stl
study report nowhere.toml | nowhere.toml: cannot be read (No such file or directory)
study run nowhere.toml | nowhere.toml: cannot be read (No such file or directory)
experiment run design.toml p01 --address mailbox:a --arm | a motor moves only with both --motor and --arm
experiment simulate design.toml --data new --participant 'Anna Smith' | expected a pseudonym
experiment plan design.toml --slot -1 | -1: the design has 4 participants, expected 0 to 3
experiment plan design.toml --slot 4 | 4: the design has 4 participants, expected 0 to 3
experiment report design.toml none | contains no sessions, expected a folder of run or simulate
experiment plan missing.toml | missing.toml: cannot be read (No such file or directory)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder of the commands, with a file of each kind."""
    for name in ("box.stl", "hand.csv"):
        shutil.copy(MESHES / name, tmp_path)
    texts = {
        "cell.toml": SCENE,
        "bad.toml": SCENE.replace("box.stl", "bax.stl"),
        "sensor.toml": SENSOR,
        "file": "",
        "points.csv": "1 2 3\n",
        "junk.stl": "?" * 84,
        "junk.obj": "?" * 84,
        "bad.csv": "0 0\n0 0 1\n",
        "pairs.csv": "first,second\nbase,lid\nbase,lit\n",
    }
    for name, text in {**texts, "part.stl": "precious"}.items():
        (tmp_path / name).write_text(text)
    shutil.copy(MESHES / "assembly.glb", tmp_path / "cell.glb")
    (tmp_path / "run.frames").write_bytes(sealed([0]))
    write_design(tmp_path).rename(tmp_path / "design.toml")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("line", REFUSED.strip().splitlines())
def test_refusal_says_what_was_expected_and_changes_no_file(run, folder, line):
    command, _, words = line.rpartition(" | ")
    before = {path: path.read_bytes() for path in folder.iterdir()}

    result = run(*shlex.split(command), stdin="")

    assert (result.code, result.out) == (2, "")
    assert words in result.words
    is_one_line = result.err.startswith("proximity: ") and result.err.count("\n") == 1
    assert is_one_line or "Usage: proximity " in result.err
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
