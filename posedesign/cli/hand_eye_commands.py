"""Commands of hand-eye calibration: robot-world, camera."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from posedesign.cli import output

if TYPE_CHECKING:
    from calib.errors import CalibError
    from calib.lens import Lens, LensName
    from calib.robot_world import NetworkResult
    from calib.robots import Robot
    from posedesign.files import Results
    from posedesign.hand_eye.pairs import Pairs
    from posedesign.hand_eye.pairs.certificate import Camera
    from posedesign.hand_eye.recordings import Taken


POSES_ARE = (
    "In what convention poses are written, with commas between the words. kuka-abc, fanuc-wpr, "
    "staubli-rxryrz, kawasaki-oat, ur-rotation-vector, abb-quaternion, and of other makers; "
    "zyx-moving, zyx-fixed and all other orders; rotation-vector, quaternion-wxyz, "
    "quaternion-xyzw. Then mm or m, deg or rad, inverse."
)

FrameWords = Annotated[
    str,
    typer.Option(
        "--frames",
        help="Names of the frames in the files of --transforms, say "
        "base=base_link,flange=tool0,camera=camera_optical_frame,target=tag; default: the links of "
        "the robot where they are known, else base, flange, camera, target.",
    ),
]

_LENS_OF_BAG = "camera_info"
"""In place of a file: the lens that a bag has."""


def robot_world(
    pairs: Annotated[
        Path | None,
        typer.Argument(
            help="Pairs A, B of A X = Z B. A table, each pose as x_mm y_mm z_mm or x_m y_m z_m "
            "with w_deg p_deg r_deg, qw qx qy qz, rx_rad ry_rad rz_rad (a rotation vector) or r11 "
            ".. r33, and a_ or b_ before each name, in capitals or not; matrices in MATLAB's .mat, "
            "NumPy's .npz or OpenCV's .xml, .yaml, .json; samples of MoveIt or easy_handeye."
        ),
    ] = None,
    a: Annotated[Path | None, typer.Option("--a", help="Or A in a file of its own,")] = None,
    b: Annotated[Path | None, typer.Option("--b", help="and B in another.")] = None,
    columns: Annotated[
        str,
        typer.Option(
            help="Names of the columns where a table has no header line, say "
            "qw,qx,qy,qz,x_m,y_m,z_m; matrix16_mm: a matrix row by row, matrix12_mm: without its "
            "last row; -: to be passed over."
        ),
    ] = "",
    variables: Annotated[
        str, typer.Option(help="Names of A and B in a file of matrices, say T_hand,T_cam.")
    ] = "",
    unit: Annotated[
        Literal["mm", "m"] | None, typer.Option(help="Unit of length in a file of matrices.")
    ] = None,
    camera: Annotated[
        output.CameraPlace,
        typer.Option(
            help="Where it is. on-flange: A = T_base_flange, B = T_target_camera. fixed, with the "
            "target on the flange: A = T_base_flange, B = T_camera_target."
        ),
    ] = "on-flange",
    invert: Annotated[
        Literal["none", "a", "b", "both"],
        typer.Option(
            help="What the files have the other way round. OpenCV's gripper2base and target2cam "
            "with the camera on the flange: b."
        ),
    ] = "none",
    convention: Annotated[
        Literal["axzb", "opencv"],
        typer.Option(
            help="opencv: A is world2cam and B is base2gripper, as calibrateRobotWorldHandEye "
            "takes them, in tables (a_, b_) or files of matrices; its base2world and gripper2cam "
            "are printed too. Where B is gripper2base: with --invert b."
        ),
    ] = "axzb",
    poses_are: Annotated[
        str,
        typer.Option(
            "--poses-are",
            help=POSES_ARE + " Of A, or with a slash of A and of B: kuka-abc/quaternion-xyzw,m.",
        ),
    ] = "",
    method: Annotated[
        str,
        typer.Option(help="Methods, with commas between them; papers: those of the papers; all."),
    ] = "ml,ml-robust,papers",
    noise_deg: Annotated[
        float | None,
        typer.Option(help="Standard deviation of rotations [deg]; default: from the residuals."),
    ] = None,
    noise_mm: Annotated[
        float | None, typer.Option(help="Standard deviation of translations [mm], likewise.")
    ] = None,
    noise_on: Annotated[
        Literal["a", "b", "both", "seen", "shown"] | None,
        typer.Option(
            help="Which side has it; default: b, and without sizes, for ml and ml-robust, what the "
            "residuals of 20 pairs or more show by far, where no cause explains them. b without "
            "sizes: that of B, the same in all directions. seen: the target as the camera sees it, "
            "as a camera's data sheet has it: with the camera on the flange, the inverse of B. "
            "shown: as the residuals show it for the standard deviations of all methods."
        ),
    ] = None,
    estimate_scale: Annotated[
        bool,
        typer.Option(
            "--estimate-scale",
            help="Estimate by what B's translations are to be multiplied, with X and Z, and "
            "correct them: where the size of the target, the unit or the focal length is not "
            "sure. Without it the scale is estimated, too, and said where it is not 1.",
        ),
    ] = False,
    prior: Annotated[
        Path | None,
        typer.Option(
            "--prior",
            help="What is known of camera and target from elsewhere, as for network: one answer by "
            "pairs and priors in place of the methods, for motions that do not tell all.",
        ),
    ] = None,
    certify: Annotated[
        bool,
        typer.Option(
            "--certify",
            help="Prove that no other X and Z are likelier by the noise assumed: needs the method "
            "ml, and noise on one side, the same in all directions: that of B where no sizes are "
            "given.",
        ),
    ] = False,
    out: output.OutFolder = Path(),
    transforms: Annotated[
        bool,
        typer.Option(
            "--transforms",
            help="Write X and Z for other tools, too, where they are to be trusted: "
            "transforms.launch.xml (ROS 2), camera.launch (ROS 1), camera.urdf (a fixed joint), "
            "camera.calib (easy_handeye2), transforms.json (cv2.FileStorage).",
        ),
    ] = False,
    frames: FrameWords = "",
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: Annotated[
        bool, typer.Option("--trust-units", help="Accept values that look like another unit.")
    ] = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Solve A X = Z B: camera on flange and target in base, or the other way.

    By one method or by many, with standard deviations, what is left over pair by pair, and what
    each pair has left over when it is left out.
    """
    from calib.errors import CalibError, NotIdentifiableError
    from posedesign.hand_eye.pairs import PairSource
    from posedesign.hand_eye.pairs import results as pair_results
    from posedesign.hand_eye.pairs.certificate import refuse_uncertifiable
    from posedesign.hand_eye.pairs.transforms import (
        TRANSFORMS,
        FrameNames,
        claim_transforms,
        write_transforms,
    )
    from posedesign.report.network import solve_and_draw_network, told_in_part
    from posedesign.report.pairs import answer_of_pairs, solve_and_draw

    named = listed(columns), listed(variables)
    source = PairSource(
        pairs, a, b, *named, unit, invert, convention, trust_units, camera, poses_are
    )
    called = FrameNames().said(listed(frames))
    methods = pair_results.methods_of(method)
    refuse_unfit_noise(methods, noise_deg, noise_mm, noise_on)
    if certify:
        # a proof is of one noise that is known beforehand, and of the answer by it
        noise_on = noise_on or "b"
        refuse_uncertifiable(methods, noise_on, camera)
    found = source.read()
    sizes = (
        None if noise_deg is None else math.radians(noise_deg),
        None if noise_mm is None else noise_mm / 1e3,
    )
    noise = pair_results.asked_noise(found, camera, *sizes, noise_on)
    results = output.results_in(out, "robot-world", pairs, a, b, prior, overwrite=overwrite)
    first = output.rehearsed_words(pairs, a, b)
    if prior is not None:
        from posedesign.hand_eye.pairs.networks import NetworkPairs
        from posedesign.hand_eye.pairs.priors import read_priors

        known = pair_results.size_of_noise(noise)
        both = NetworkPairs.of_one(found, camera)
        result = solve_and_draw_network(both, results, known, read_priors(prior))
        return _tell_in_part(found, camera, result, out, first, verbose=verbose, as_json=as_json)
    claims = claim_transforms(results) if transforms else []
    try:
        with output.progress("A X = Z B", quiet=as_json) as advance:
            outcomes = solve_and_draw(
                found, results, methods, noise, advance, estimate_scale=estimate_scale
            )
            outcomes = pair_results.certified(found, outcomes) if certify else outcomes
    except NotIdentifiableError as error:
        known = pair_results.size_of_noise(noise)
        part = None if certify or estimate_scale else told_in_part(found, camera, results, known)
        if part is None:
            _say_how_read(found, error)
            raise
        return _tell_in_part(found, camera, part, out, first, verbose=verbose, as_json=as_json)
    except CalibError as error:
        _say_how_read(found, error)
        raise
    opencv = convention == "opencv"
    made = ("robot_world.csv", "robot_world_pairs.csv", "robot_world.png")
    files = [str(out / name) for name in made if (out / name).is_file()]
    trusted = outcomes[0].result if pair_results.reached(outcomes) else None
    if claims and trusted is not None:
        write_transforms(claims, trusted, camera, called)
        files += [str(claim.path) for claim in claims]
    else:
        results.remove(*TRANSFORMS)
    inverted = invert in ("b", "both")
    answer = answer_of_pairs(
        outcomes, camera, found, files, opencv=opencv, inverted=inverted, names=called
    )
    content = [pair_results.outcome_as_dict(found, one, camera, opencv=opencv) for one in outcomes]
    good = pair_results.reached(outcomes)
    return output.tell(answer, good, verbose=verbose, first=first, content=content, as_json=as_json)


def _tell_in_part(
    pairs: Pairs,
    camera: Camera,
    result: NetworkResult,
    out: Path,
    first: str,
    *,
    verbose: bool,
    as_json: bool,
) -> int:
    """Say what pairs of one camera and one target tell, and what not."""
    from posedesign.hand_eye.pairs.networks import NetworkPairs, network_as_dict
    from posedesign.report.network import FILES, answer_of_network

    files = [str(out / name) for name, _ in FILES if (out / name).is_file()]
    return output.tell(
        answer_of_network(NetworkPairs.of_one(pairs, camera), result, files),
        result.is_ok,
        verbose=verbose,
        first=first,
        content=network_as_dict(result),
        as_json=as_json,
    )


def _say_how_read(pairs: Pairs, error: CalibError) -> None:
    """Say before an error what is odd about pairs as they were read."""
    from calib.errors import InputError

    for text in pairs.notes:
        output.note(f"warning: {text}")
    if pairs.misread and isinstance(error, InputError) and error.name == "pairs":
        # the same finding, but by one who knows how the numbers were read
        raise InputError(pairs.misread, name="pairs") from error
    if pairs.misread:
        output.note(f"warning: {pairs.misread}")


def refuse_unfit_noise(
    methods: Sequence[str], noise_deg: float | None, noise_mm: float | None, noise_on: str | None
) -> None:
    """Both sizes of the noise, none below zero, or nothing of it."""
    from calib.errors import InputError
    from calib.robot_world import METHODS
    from posedesign.files import LEAST_POSITIVE, usable

    weighing = [name for name in methods if METHODS[name].likelihood]
    for option, value, unit in (("--noise-deg", noise_deg, "deg"), ("--noise-mm", noise_mm, "mm")):
        if value is None or usable(value) >= LEAST_POSITIVE:
            continue
        if value == 0.0 and not weighing:
            continue
        what = f"and {weighing[0]} weighs by it" if value == 0.0 else "no standard deviation"
        raise InputError(
            f"{option} is {value:g} {unit}, {what}",
            hint=f"give one above 0 {unit}, or leave the noise to the residuals",
            name=option,
            value=value,
            bound=0.0,
        )
    if noise_on == "shown":
        if noise_deg is not None or noise_mm is not None:
            raise InputError(
                "--noise-on shown finds the sizes itself: give no others", name="noise"
            )
        return
    if (noise_deg is None) != (noise_mm is None):
        raise InputError("give both --noise-deg and --noise-mm, or neither", name="noise")
    if noise_deg is None and noise_on not in (None, "b"):
        raise InputError(
            f"--noise-on {noise_on} needs --noise-deg and --noise-mm",
            hint="b and shown alone have their sizes from the residuals",
            name="noise",
        )


def listed(text: str) -> list[str]:
    """Names with commas between them."""
    return [name.strip() for name in text.split(",")] if text.strip() else []


def camera(
    cell: Annotated[
        Path | None,
        typer.Argument(
            help="The cell, made with: posedesign new > cell.toml. It may be left out where "
            "--poses has poses of the flange and --target describes the board."
        ),
    ] = None,
    pictures: Annotated[
        Path | None,
        typer.Argument(
            help="A folder of pictures of the board that [board] describes; of several cameras a "
            "folder each in it, with the same names for pictures of one stop. Or a video: a still "
            "is taken each time the picture stands."
        ),
    ] = None,
    joints: Annotated[
        Path | None,
        typer.Option(
            "--joints",
            "--poses",
            help="Joints of each picture (j1_deg ..), or poses of the flange (x_mm .. r_deg and "
            "other forms), by the column picture or in the order of the pictures; or a list for "
            "ROS or RoboDK; poses in YAML or JSON, or a folder with a file for each. Of a video: "
            "by the column time_s or frame, or in the order of the stills.",
        ),
    ] = None,
    bag: Annotated[
        Path | None,
        typer.Option(
            "--bag",
            help="A bag of ROS 2 in place of pictures and joints: its folder, or a file .mcap or "
            ".db3. A still is taken each time the arm stands.",
        ),
    ] = None,
    image_topic: Annotated[
        str | None, typer.Option("--image-topic", help="Pictures in the bag; default: the only.")
    ] = None,
    joint_topic: Annotated[
        str | None,
        typer.Option("--joint-topic", help="Joints in the bag (JointState), likewise."),
    ] = None,
    pose_topic: Annotated[
        str | None,
        typer.Option(
            "--pose-topic",
            help="Or poses of the flange (PoseStamped, TransformStamped); needs no cell.",
        ),
    ] = None,
    tf: Annotated[
        str | None,
        typer.Option("--tf", help="Or the base frame and the flange frame, say base_link,tool0."),
    ] = None,
    stand_s: Annotated[
        float | None,
        typer.Option("--stand-s", help="Shortest stand-still in a bag or video [s]. [0.3]"),
    ] = None,
    time_offset_s: Annotated[
        float | None,
        typer.Option("--time-offset-s", help="Added to the times of pictures in them [s]. [0]"),
    ] = None,
    moving: Annotated[
        bool,
        typer.Option(
            "--moving",
            help="Take pictures of a moving arm from the bag; how much later than its joints they "
            "are is estimated.",
        ),
    ] = False,
    poses_are: Annotated[str, typer.Option("--poses-are", help=POSES_ARE)] = "",
    camera: Annotated[
        output.CameraPlace | None,
        typer.Option(
            help="on-flange: eye-in-hand. fixed: eye-to-hand, the board on the flange. Default: as "
            "camera.mount of the cell says."
        ),
    ] = None,
    lens: Annotated[
        str,
        typer.Option(
            help="Estimate a pinhole (5 terms of distortion), rational (8) or fisheye lens; or a "
            "file of a lens that is known: camera.json, camera_info.yaml; camera_info: that of the "
            "bag."
        ),
    ] = "pinhole",
    free: Annotated[
        str,
        typer.Option(
            "--free",
            help="What of the robot to identify with it, with commas: zero_offsets, geometry, "
            "compliance, priors; default: all that may be off, where the pictures show it.",
        ),
    ] = "",
    target: Annotated[
        str,
        typer.Option(
            help="In place of the board of the cell: a target of Kalibr or of robot_cal_tools "
            "(YAML), or keys as in [board], in a file or here, say "
            "kind=chessboard,columns=10,rows=7,square_mm=18."
        ),
    ] = "",
    board_errors: Annotated[
        str,
        typer.Option(
            "--board-errors",
            help="Of the board: scale, bend_x, bend_y. What the pictures show, by default.",
        ),
    ] = "",
    pixel_sigma: Annotated[
        float | None,
        typer.Option("--pixel-sigma", help="Noise of a point [px]; from the pictures by default."),
    ] = None,
    arm_mm: Annotated[
        float | None,
        typer.Option(
            "--arm-mm", help="How far the arm stops from where it says [mm]; from the pictures."
        ),
    ] = None,
    arm_deg: Annotated[
        float | None, typer.Option("--arm-deg", help="The same of its turn [deg].")
    ] = None,
    order: Annotated[
        Literal["name", "time"],
        typer.Option(
            help="Order of the pictures: by name, or by the time that they were taken at."
        ),
    ] = "name",
    out: output.OutFolder = Path(),
    transforms: Annotated[
        bool,
        typer.Option(
            "--transforms",
            help="Write camera, board and lens for other tools, too: ROS 2, URDF, easy_handeye2, "
            "OpenCV, camera_info.yaml.",
        ),
    ] = False,
    frames: FrameWords = "",
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Calibrate a camera from pictures of a board: its place, its lens, and the board's place.

    One estimate over all pixels, with standard deviations; pictures that contradict the others
    take no part, and what looks wrong is named.
    """
    from calib.errors import InputError
    from posedesign.cell import Cell
    from posedesign.hand_eye import Asked
    from posedesign.hand_eye.board_files import board_said, cell_of
    from posedesign.hand_eye.calibration import board_of, result_as_dict
    from posedesign.hand_eye.pairs.transforms import FrameNames
    from posedesign.hand_eye.pictures import cameras_in, read_picture_set
    from posedesign.hand_eye.recordings.bags import is_bag
    from posedesign.report.hand_eye import answer_of_camera
    from posedesign.workflow import calibrate_from_pictures

    _check_order(cell, pictures, bag)
    if bag is None and pictures is None:
        cell, pictures = None, cell  # the one that is given is of pictures
    if bag is None and pictures is not None and is_bag(pictures):
        bag, pictures = pictures, None
    loaded = cell_of(target) if cell is None else Cell.load(cell)
    board = board_said(target) if target else board_of(loaded)  # said before all else
    robot = None if cell is None else loaded.robot
    ends = (listed(tf or "") if robot is None or tf else [robot.base_frame, robot.tip_frame])[:2]
    called = (FrameNames().arm(*ends) if len(ends) == 2 else FrameNames()).said(listed(frames))
    of_bag = {
        "image_topic": image_topic,
        "joint_topic": joint_topic,
        "pose_topic": pose_topic,
        "tf": tf,
        "moving": moving or None,
    }
    of_both = {"stand_s": stand_s, "time_offset_s": time_offset_s}
    is_in_bag = bag is not None and lens == _LENS_OF_BAG
    known = None if is_in_bag else lens_of(lens)
    stills = output.results_in(out, "camera", overwrite=overwrite)
    taken = _take_stills(bag, pictures, joints, is_in_bag, of_bag, of_both, robot, stills, as_json)
    if taken is not None:
        pictures, joints = taken.pictures, taken.table
    if pictures is None:
        raise InputError(
            "there are no pictures",
            hint="give the cell and a folder of pictures, or a video; or the cell and `bag`",
            name="pictures",
        )
    asked = Asked(
        camera or ("fixed" if loaded.camera_stands else "on-flange"),
        known or lens_of(str(taken.lens if taken else lens)),
        tuple(listed(free)),
        tuple(listed(board_errors)),
        pixel_sigma,
        arm_sigma_of(arm_mm, arm_deg),
        board,
    )
    table = None if joints is None or joints.is_dir() else joints
    results = output.results_in(out, "camera", cell, table, overwrite=overwrite)
    shown = {
        name: read_picture_set(
            own, joints, robot, order=order, trust_units=trust_units, poses_are=poses_are
        )
        for name, own in cameras_in(pictures).items()
    }
    if not tf and any(own.postures is None for own in shown.values()):
        # poses of a controller are in a base of its own, which need not be that of the links
        called = FrameNames().said(listed(frames))
    with output.progress("calibrating the camera", with_time_left=True) as advance:
        found, files = calibrate_from_pictures(
            loaded, shown, asked, results, advance, transforms=transforms, frames=called
        )
    return output.tell(
        answer_of_camera(found, [str(path) for path in files], called),
        found.result.is_ok,
        verbose=verbose,
        first=output.rehearsed_words(table),
        content=result_as_dict(found),
        as_json=as_json,
    )


def _check_order(cell: Path | None, pictures: Path | None, bag: Path | None) -> None:
    """Refuse a cell in the place of the pictures, and the other way round."""
    from calib.errors import InputError

    hint = "give first the cell, then the folder of pictures, the video or the bag"
    if cell is not None and pictures is not None and cell.is_dir():
        raise InputError(f"{cell} is a folder, and no cell", hint=hint, name="cell")
    shown = cell if pictures is None and bag is None else pictures
    if shown is not None and shown.suffix.casefold() == ".toml":
        raise InputError(f"{shown} has no pictures, it is a cell", hint=hint, name="pictures")


def _take_stills(
    bag: Path | None,
    pictures: Path | None,
    joints: Path | None,
    lens_of_bag: bool,
    of_bag: Mapping[str, Any],
    of_both: Mapping[str, Any],
    robot: Robot | None,
    results: Results,
    quiet: bool,
) -> Taken | None:
    """Take the stills of a bag or a video, and say how many; None where pictures are in files."""
    from posedesign.hand_eye.recordings import Recording, take_from_bag, take_from_video
    from posedesign.hand_eye.recordings.videos import is_video

    path = bag or pictures
    if bag is None:
        output.refuse_given(of_bag, "is for a bag, and there is none: `bag`")
    else:
        why = "is not taken with a bag"
        output.refuse_given({"pictures": pictures, "joints": joints}, why)
    if path is None or (bag is None and not is_video(path)):
        output.refuse_given(of_both, "is for a bag or a video")
        return None
    given = {name: value for name, value in {**of_bag, **of_both}.items() if value is not None}
    recording = Recording(path, lens_of_bag=lens_of_bag, **given)
    with output.progress("taking stills", quiet=quiet) as advance:
        taken = (
            take_from_video(recording, joints, results, advance)
            if bag is None
            else take_from_bag(recording, robot, results, advance)
        )
    for text in (taken.said, *taken.notes):
        output.note(f"note: {text}")
    return taken


def lens_of(text: str) -> LensName | Lens:
    """The model of a lens by its name, or the lens of a file."""
    from calib.errors import InputError, near_names
    from calib.lens import DISTORTION
    from posedesign.hand_eye.lens_files import read_lens

    if text in DISTORTION:
        return cast("LensName", text)
    if not Path(text).exists() and "." not in text:
        raise InputError(
            f"--lens {text}: there is no such lens, and no such file",
            hint=near_names(text, tuple(DISTORTION)),
            name="lens",
        )
    return read_lens(Path(text))


def arm_sigma_of(mm: float | None, deg: float | None) -> tuple[float, float] | None:
    """How far the arm stops from where it says [m, rad], if both are given."""
    from calib.errors import InputError

    if mm is None and deg is None:
        return None
    if mm is None or deg is None or not (mm >= 0 and deg >= 0):
        raise InputError(
            "give both --arm-mm and --arm-deg, not below zero, or neither",
            hint="without them both are found from the pictures",
            name="arm",
        )
    return mm / 1e3, math.radians(deg)
