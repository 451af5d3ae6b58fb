# SPDX-License-Identifier: Apache-2.0
"""The compiled part of pilotage; import its names from `pilotage`."""

from collections.abc import Sequence
import enum
from typing import Annotated, overload

import numpy
from numpy.typing import NDArray

class Transform:
    """
    Rigid transform; a variable `b_from_a` maps coordinates: point_in_b = b_from_a @ point_in_a.
    """

    def __init__(
        self,
        *,
        translation_m: Sequence[float] = [0.0, 0.0, 0.0],
        quaternion_wxyz: Sequence[float] = [1.0, 0.0, 0.0, 0.0],
    ) -> None:
        """
        Translation (3,) in metres and unit quaternion (4,), w first; identity by default.
        """

    @staticmethod
    def from_matrix(
        matrix: Annotated[NDArray[numpy.float64], dict(shape=(4, 4), order="F")],
    ) -> Transform:
        """From a (4, 4) matrix; ValueError unless its rotation is one."""

    @staticmethod
    def exp(twist: Annotated[NDArray[numpy.float64], dict(shape=(6), order="C")]) -> Transform:
        """
        SE(3) exponential of a twist (6,): translation part (m), rotation part (rad).
        """

    def log(self) -> Annotated[NDArray[numpy.float64], dict(shape=(6), order="C")]:
        """Twist (6,) with exp(log(t)) = t, angle in [0, pi]."""

    def matrix(self) -> Annotated[NDArray[numpy.float64], dict(shape=(4, 4), order="F")]:
        """The (4, 4) homogeneous matrix."""

    def inverse(self) -> Transform:
        """a_from_b of b_from_a."""

    @property
    def translation_m(self) -> Annotated[NDArray[numpy.float64], dict(shape=(3), order="C")]:
        """(3,), metres."""

    @property
    def quaternion_wxyz(self) -> Annotated[NDArray[numpy.float64], dict(shape=(4), order="C")]:
        """(4,), unit length, w first."""

    @overload
    def __matmul__(self, other: Transform) -> Transform:
        """c_from_b @ b_from_a = c_from_a."""

    @overload
    def __matmul__(
        self, point: Annotated[NDArray[numpy.float64], dict(shape=(3), order="C")]
    ) -> Annotated[NDArray[numpy.float64], dict(shape=(3), order="C")]:
        """One point (3,)."""

    @overload
    def __matmul__(
        self, points: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)]
    ) -> Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order="C")]:
        """Points (N, 3) in a to points (N, 3) in b."""

    def __getstate__(self) -> list[float]: ...
    def __setstate__(self, arg: Sequence[float], /) -> None: ...
    def __repr__(self) -> str: ...

class Camera:
    """
    Pinhole camera with its lens; x right, y down, z forward, pixel (0, 0) at the centre of the first pixel. ValueError when it cannot be one.
    """

    def __init__(
        self,
        *,
        width_px: int,
        height_px: int,
        fx_px: float,
        fy_px: float,
        cx_px: float,
        cy_px: float,
        distortion: str = "none",
        coefficients: Sequence[float] = [],
    ) -> None:
        """
        distortion: 'none', 'brown' (k1 k2 p1 p2 [k3]) or 'kannala_brandt' (k1 k2 k3 k4).
        """

    @property
    def width_px(self) -> int: ...
    @property
    def height_px(self) -> int: ...
    @property
    def fx_px(self) -> float: ...
    @property
    def fy_px(self) -> float: ...
    @property
    def cx_px(self) -> float: ...
    @property
    def cy_px(self) -> float: ...
    @property
    def distortion(self) -> str: ...
    @property
    def coefficients(self) -> list[float]:
        """As many as the lens model has."""

    def project(
        self,
        points_in_camera: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)],
    ) -> Annotated[NDArray[numpy.float64], dict(shape=(None, 2), order="C")]:
        """
        Pixels (N, 2) of points (N, 3) in metres, inside the picture or not; NaN behind the camera and where the lens model folds over.
        """

    def unproject(
        self, pixels: Annotated[NDArray[numpy.float64], dict(shape=(None, 2), writable=False)]
    ) -> Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order="C")]:
        """
        Unit rays (N, 3) of pixels (N, 2); NaN where the lens model has no inverse.
        """

    def __repr__(self) -> str: ...

class StereoRig:
    """
    A stereo pair as calibrated, side by side. ValueError when it cannot be one: unequal pictures, no baseline, left and right swapped.
    """

    def __init__(
        self,
        *,
        left: Camera,
        right: Camera,
        right_from_left: Transform,
        robot_from_left: Transform | None = None,
        readout_s: float = 0.0,
    ) -> None: ...
    @property
    def left(self) -> Camera: ...
    @property
    def right(self) -> Camera: ...
    @property
    def right_from_left(self) -> Transform: ...
    @property
    def robot_from_left(self) -> Transform | None:
        """Where the left camera sits on the robot, or None."""

    @property
    def readout_s(self) -> float:
        """
        Rolling shutter: how much later (s) the last row is exposed than the first, in both cameras; a pair's time is that of its middle row. 0: all rows at once.
        """

    @property
    def baseline_m(self) -> float: ...
    def validate(self) -> None:
        """ValueError naming the value that is wrong."""

class RectifiedStereo:
    """
    The ideal pair: equal focal lengths, rows that coincide. disparity = x_left - x_right - (cx_px - cx_right_px).
    """

    def __init__(
        self,
        *,
        width_px: int,
        height_px: int,
        focal_px: float,
        cx_px: float,
        cy_px: float,
        cx_right_px: float,
        baseline_m: float,
    ) -> None: ...
    @property
    def width_px(self) -> int: ...
    @property
    def height_px(self) -> int: ...
    @property
    def focal_px(self) -> float: ...
    @property
    def cx_px(self) -> float: ...
    @property
    def cy_px(self) -> float: ...
    @property
    def cx_right_px(self) -> float: ...
    @property
    def baseline_m(self) -> float: ...

class Rectifier:
    """Turns pictures of a calibrated pair into pictures of an ideal pair."""

    def __init__(self, *, rig: StereoRig, interpolation: str = "cubic") -> None:
        """
        interpolation: 'bilinear' or 'cubic' (four neighbours each way, half of the shift).
        """

    @property
    def stereo(self) -> RectifiedStereo: ...
    @property
    def rectified_from_left(self) -> Transform:
        """
        From coordinates of the real left camera to those of the ideal one: a pure rotation.
        """

    @property
    def rectified_from_right(self) -> Transform:
        """The same of the right camera."""

    @property
    def is_identity(self) -> bool:
        """True when the pictures are ideal already."""

    def rectify(
        self,
        image: Annotated[
            NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)
        ],
        side: str = "left",
    ) -> Annotated[NDArray[numpy.uint8], dict(shape=(None, None))]:
        """
        Ideal picture (height, width) uint8 of a calibrated one, rows of any stride, not copied; pixels without a source are 0. ValueError when its size is another.
        """

def triangulate(
    *,
    rig: StereoRig,
    left_px: Annotated[NDArray[numpy.float64], dict(shape=(None, 2), writable=False)],
    right_px: Annotated[NDArray[numpy.float64], dict(shape=(None, 2), writable=False)],
) -> Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order="C")]:
    """
    Points (N, 3) in the left camera, metres, of real (not rectified) pixels (N, 2) of both pictures; NaN where rays diverge.
    """

class HarrisOptions:
    """How corners are found; see HarrisDetector."""

    def __init__(self) -> None: ...

    class Response(enum.Enum):
        """What a pixel's score is."""

        harris = 0

        minimal_eigenvalue = 1

    @property
    def response(self) -> HarrisOptions.Response: ...
    @response.setter
    def response(self, arg: HarrisOptions.Response, /) -> None: ...
    @property
    def cell_px(self) -> int: ...
    @cell_px.setter
    def cell_px(self, arg: int, /) -> None: ...
    @property
    def points_per_cell(self) -> int: ...
    @points_per_cell.setter
    def points_per_cell(self, arg: int, /) -> None: ...
    @property
    def min_distance_px(self) -> float: ...
    @min_distance_px.setter
    def min_distance_px(self, arg: float, /) -> None: ...
    @property
    def min_score(self) -> float: ...
    @min_score.setter
    def min_score(self, arg: float, /) -> None: ...
    @property
    def relative_threshold(self) -> float: ...
    @relative_threshold.setter
    def relative_threshold(self, arg: float, /) -> None: ...
    @property
    def border_px(self) -> int: ...
    @border_px.setter
    def border_px(self, arg: int, /) -> None: ...

class InterestOptions:
    """Corners on a pyramid and their descriptors."""

    def __init__(self) -> None: ...
    @property
    def harris(self) -> HarrisOptions: ...
    @harris.setter
    def harris(self, arg: HarrisOptions, /) -> None: ...
    @property
    def levels(self) -> int: ...
    @levels.setter
    def levels(self, arg: int, /) -> None: ...
    @property
    def level_factor(self) -> float: ...
    @level_factor.setter
    def level_factor(self, arg: float, /) -> None: ...
    @property
    def is_oriented(self) -> bool: ...
    @is_oriented.setter
    def is_oriented(self, arg: bool, /) -> None: ...

class StereoMatchOptions:
    """How match_stereo searches and judges."""

    def __init__(self) -> None: ...
    @property
    def min_disparity_px(self) -> int: ...
    @min_disparity_px.setter
    def min_disparity_px(self, arg: int, /) -> None: ...
    @property
    def max_disparity_px(self) -> int: ...
    @max_disparity_px.setter
    def max_disparity_px(self, arg: int, /) -> None: ...
    @property
    def row_tolerance_px(self) -> float: ...
    @row_tolerance_px.setter
    def row_tolerance_px(self, arg: float, /) -> None: ...
    @property
    def min_correlation(self) -> float: ...
    @min_correlation.setter
    def min_correlation(self, arg: float, /) -> None: ...
    @property
    def uniqueness(self) -> float: ...
    @uniqueness.setter
    def uniqueness(self, arg: float, /) -> None: ...
    @property
    def left_right_tolerance_px(self) -> int: ...
    @left_right_tolerance_px.setter
    def left_right_tolerance_px(self, arg: int, /) -> None: ...

class SubpixelOptions:
    """How refine_matches works."""

    def __init__(self) -> None: ...
    @property
    def half_width_px(self) -> int: ...
    @half_width_px.setter
    def half_width_px(self, arg: int, /) -> None: ...
    @property
    def half_height_px(self) -> int: ...
    @half_height_px.setter
    def half_height_px(self, arg: int, /) -> None: ...
    @property
    def max_iterations(self) -> int: ...
    @max_iterations.setter
    def max_iterations(self, arg: int, /) -> None: ...
    @property
    def max_shift_px(self) -> float: ...
    @max_shift_px.setter
    def max_shift_px(self, arg: float, /) -> None: ...
    @property
    def along_row_only(self) -> bool: ...
    @along_row_only.setter
    def along_row_only(self, arg: bool, /) -> None: ...
    @property
    def doubts_gradients(self) -> bool: ...
    @doubts_gradients.setter
    def doubts_gradients(self, arg: bool, /) -> None: ...

class DescriptorMatchOptions:
    """Ratio and mutual tests."""

    def __init__(self) -> None: ...
    @property
    def max_distance(self) -> float: ...
    @max_distance.setter
    def max_distance(self, arg: float, /) -> None: ...
    @property
    def max_ratio(self) -> float: ...
    @max_ratio.setter
    def max_ratio(self, arg: float, /) -> None: ...
    @property
    def is_mutual(self) -> bool: ...
    @is_mutual.setter
    def is_mutual(self, arg: bool, /) -> None: ...

def detect_corners(
    *,
    image: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
    options: HarrisOptions = ...,
) -> NDArray[numpy.float32]:
    """
    Corners spread over a (height, width) uint8 picture: (N, 3) float32 of x_px, y_px and score in (grey/px)^2, strongest first.
    """

def detect_stable_regions(
    *,
    image: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
) -> NDArray[numpy.float32]:
    """
    Maximally stable extremal regions of a (height, width) uint8 picture: (N, 4) float32 of x_px and y_px of their centres of mass, geometric mean of their standard deviations along both axes in pixels, and 1 less their growth over five grey levels.
    """

def describe_points(
    *,
    image: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
    points_px: Annotated[
        NDArray[numpy.float32], dict(shape=(None, 2), order="C", device="cpu", writable=False)
    ],
    angles_rad: Annotated[
        NDArray[numpy.float32], dict(shape=(None,), order="C", device="cpu", writable=False)
    ]
    | None = None,
) -> NDArray[numpy.uint8]:
    """
    SIFT descriptors, (N, 128) uint8, of (N, 2) float32 points, upright or turned by angles from x towards y.
    """

def describe_interest_points(
    *,
    image: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
    options: InterestOptions = ...,
) -> dict:
    """
    Corners of all scales with their descriptors: dict of points_px (N, 2), levels, scales, scores, angles_rad and descriptors (N, 128).
    """

def match_stereo(
    *,
    left: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
    right: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
    points_px: Annotated[
        NDArray[numpy.float32], dict(shape=(None, 2), order="C", device="cpu", writable=False)
    ],
    options: StereoMatchOptions = ...,
) -> dict:
    """
    Disparity of (N, 2) left points of a rectified pair: dict of disparity_px, dy_px, sigma_px, score, peak_ratio and ok (0 where there is no match), each (N,).
    """

def refine_matches(
    *,
    a: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
    points_in_a_px: Annotated[
        NDArray[numpy.float32], dict(shape=(None, 2), order="C", device="cpu", writable=False)
    ],
    b: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
    guesses_in_b_px: Annotated[
        NDArray[numpy.float32], dict(shape=(None, 2), order="C", device="cpu", writable=False)
    ],
    options: SubpixelOptions = ...,
    a_from_b: Annotated[
        NDArray[numpy.float32], dict(shape=(None, 2, 2), order="C", device="cpu", writable=False)
    ]
    | None = None,
) -> dict:
    """
    Refine matches by least-squares correlation: dict of position_px (N, 2), sigma_px (N, 2), correlation and ok. a_from_b (N, 2, 2) float32 maps offsets from a point in b to those in a; without it patches look alike in both.
    """

def match_all(
    *,
    a: Annotated[
        NDArray[numpy.uint8], dict(shape=(None, 128), order="C", device="cpu", writable=False)
    ],
    b: Annotated[
        NDArray[numpy.uint8], dict(shape=(None, 128), order="C", device="cpu", writable=False)
    ],
    options: DescriptorMatchOptions = ...,
) -> dict:
    """
    Match (N, 128) and (M, 128) uint8 descriptors: dict of pairs (K, 2), distance and ratio.
    """

def match_along_rows(
    *,
    left_px: Annotated[
        NDArray[numpy.float32], dict(shape=(None, 2), order="C", device="cpu", writable=False)
    ],
    left: Annotated[
        NDArray[numpy.uint8], dict(shape=(None, 128), order="C", device="cpu", writable=False)
    ],
    right_px: Annotated[
        NDArray[numpy.float32], dict(shape=(None, 2), order="C", device="cpu", writable=False)
    ],
    right: Annotated[
        NDArray[numpy.uint8], dict(shape=(None, 128), order="C", device="cpu", writable=False)
    ],
    row_tolerance_px: float = 1.5,
    min_disparity_px: float = 0.0,
    max_disparity_px: float = 192.0,
    options: DescriptorMatchOptions = ...,
) -> dict:
    """
    Match descriptors of a rectified pair along its rows; result as of match_all.
    """

def match_in_windows(
    *,
    predicted_px: Annotated[
        NDArray[numpy.float32], dict(shape=(None, 2), order="C", device="cpu", writable=False)
    ],
    radius_px: Annotated[
        NDArray[numpy.float32], dict(shape=(None,), order="C", device="cpu", writable=False)
    ],
    a: Annotated[
        NDArray[numpy.uint8], dict(shape=(None, 128), order="C", device="cpu", writable=False)
    ],
    b_px: Annotated[
        NDArray[numpy.float32], dict(shape=(None, 2), order="C", device="cpu", writable=False)
    ],
    b: Annotated[
        NDArray[numpy.uint8], dict(shape=(None, 128), order="C", device="cpu", writable=False)
    ],
    options: DescriptorMatchOptions = ...,
) -> dict:
    """
    Match each of a to those of b within radius_px, (N,) or (1,), of its predicted place.
    """

def correlate(
    *,
    image: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
    centre_px: Annotated[NDArray[numpy.float32], dict(shape=(2), order="C")],
    other: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)],
    x_first: int,
    y_first: int,
    width: int,
    height: int,
) -> NDArray[numpy.float32]:
    """
    Zero-mean normalised correlation, (height, width) float32, of the 16x16 patch around centre_px (x, y) of `image` with the patches of `other` that begin at x_first + i, y_first + j. ValueError when patches leave the pictures.
    """

class PlaneMotion:
    """
    How the picture of a plane turned and moved: current = turn * (reference - centre) + centre + shift.
    """

    @property
    def turn_rad(self) -> float: ...
    @property
    def shift_px(self) -> Annotated[NDArray[numpy.float64], dict(shape=(2), order="C")]: ...
    @property
    def score(self) -> float:
        """How much what both pictures show agrees, 0..1."""

def find_plane_motions(
    *,
    reference: Annotated[
        NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)
    ],
    current: Annotated[
        NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)
    ],
    centre_px: Annotated[NDArray[numpy.float64], dict(shape=(2), order="C")],
) -> list[PlaneMotion]:
    """
    Up to two motions of a picture within its plane, turned by up to 34 degrees about centre_px, the best first; none where there is none to be found.
    """

def self_similarity(
    picture: Annotated[
        NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)
    ],
) -> float:
    """
    How much a (height, width) uint8 picture looks like itself elsewhere, 0..1: near 1 where a pattern repeats.
    """

class RobustLoss(enum.Enum):
    """Weight functions of robust adjustment."""

    none = 0

    danish = 1

    huber = 2

    cauchy = 3

    tukey = 4

    geman_mcclure = 5

def robust_weight(*, loss: RobustLoss, normalised: float, iteration: int = 1) -> float:
    """
    Weight in [0, 1] of a residual of `normalised` = |v| / sigma; iteration counts from 1.
    """

class EpipolarResidual(enum.Enum):
    """What is taken for the residual y-parallax."""

    sampson = 0

    paper_f33 = 1

class EpipolarOptions:
    """Settings of find_blunders."""

    def __init__(self) -> None: ...
    @property
    def residual(self) -> EpipolarResidual: ...
    @residual.setter
    def residual(self, arg: EpipolarResidual, /) -> None: ...
    @property
    def threshold_px(self) -> float: ...
    @threshold_px.setter
    def threshold_px(self, arg: float, /) -> None: ...
    @property
    def rejection(self) -> float: ...
    @rejection.setter
    def rejection(self, arg: float, /) -> None: ...
    @property
    def min_sigma_px(self) -> float: ...
    @min_sigma_px.setter
    def min_sigma_px(self, arg: float, /) -> None: ...
    @property
    def confidence(self) -> float: ...
    @confidence.setter
    def confidence(self, arg: float, /) -> None: ...
    @property
    def min_samples(self) -> int: ...
    @min_samples.setter
    def min_samples(self, arg: int, /) -> None: ...
    @property
    def max_samples(self) -> int: ...
    @max_samples.setter
    def max_samples(self, arg: int, /) -> None: ...
    @property
    def min_inliers(self) -> int: ...
    @min_inliers.setter
    def min_inliers(self, arg: int, /) -> None: ...
    @property
    def min_inlier_share(self) -> float: ...
    @min_inlier_share.setter
    def min_inlier_share(self, arg: float, /) -> None: ...
    @property
    def seed(self) -> int: ...
    @seed.setter
    def seed(self, arg: int, /) -> None: ...

class EpipolarCheck:
    """Matches judged by their epipolar geometry."""

    @property
    def fundamental(self) -> Annotated[NDArray[numpy.float64], dict(shape=(3, 3), order="F")]:
        """(3, 3), b^T F a = 0 in pixels."""

    @property
    def inlier(self) -> NDArray[numpy.bool_]:
        """(N,) bool; all true unless ok."""

    @property
    def m_q(self) -> float:
        """rms residual y-parallax of the inliers (pixels)."""

    @property
    def sigma(self) -> float: ...
    @property
    def iterations(self) -> int: ...
    @property
    def degenerate(self) -> bool: ...
    @property
    def ok(self) -> bool: ...

def find_blunders(
    *,
    points_a: Annotated[NDArray[numpy.float64], dict(shape=(None, 2), writable=False)],
    points_b: Annotated[NDArray[numpy.float64], dict(shape=(None, 2), writable=False)],
    options: EpipolarOptions = ...,
    qualities: Annotated[
        NDArray[numpy.float32], dict(shape=(None,), order="C", device="cpu", writable=False)
    ]
    | None = None,
) -> EpipolarCheck:
    """
    Judge matches of two pictures by their fundamental matrix. points: (N, 2) pixels; qualities:
    (N,) float32, larger is better. Raises ValueError for lengths that differ or NaN.
    """

def solve_p3p(
    *,
    points: Annotated[NDArray[numpy.float64], dict(shape=(3, 3), order="F")],
    rays: Annotated[NDArray[numpy.float64], dict(shape=(3, 3), order="F")],
) -> list[Transform]:
    """
    Poses camera_from_points (at most four) that see three points (3, 3), one a row, metres,
    along three rays (3, 3).
    """

class PoseRansacOptions:
    """Settings of resect_ransac."""

    def __init__(self) -> None: ...
    @property
    def threshold_sigma(self) -> float: ...
    @threshold_sigma.setter
    def threshold_sigma(self, arg: float, /) -> None: ...
    @property
    def confidence(self) -> float: ...
    @confidence.setter
    def confidence(self, arg: float, /) -> None: ...
    @property
    def max_samples(self) -> int: ...
    @max_samples.setter
    def max_samples(self, arg: int, /) -> None: ...
    @property
    def min_inliers(self) -> int: ...
    @min_inliers.setter
    def min_inliers(self, arg: int, /) -> None: ...
    @property
    def seed(self) -> int: ...
    @seed.setter
    def seed(self, arg: int, /) -> None: ...

class PoseRansacResult:
    """A pose found among gross errors, or none."""

    @property
    def camera_from_points(self) -> Transform | None: ...
    @property
    def inlier(self) -> NDArray[numpy.bool_]:
        """(N,) bool."""

    @property
    def inlier_count(self) -> int: ...
    @property
    def samples(self) -> int: ...

def resect_ransac(
    *,
    points_in_previous: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)],
    observed_px: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)],
    stereo: RectifiedStereo,
    left_sigma_px: float = 1.0,
    right_sigma_px: float = 1.0,
    options: PoseRansacOptions = ...,
    point_covariances: Annotated[
        NDArray[numpy.float64], dict(shape=(None, 3, 3), order="C", device="cpu", writable=False)
    ]
    | None = None,
    qualities: Annotated[
        NDArray[numpy.float32], dict(shape=(None,), order="C", device="cpu", writable=False)
    ]
    | None = None,
) -> PoseRansacResult:
    """
    Pose of a rectified pair from points (N, 3), metres in the previous left camera, and what is
    seen of them, (N, 3) rows of left x, left y, right x (NaN: left only); gross errors allowed.
    point_covariances: (N, 3, 3); qualities: (N,) float32.
    """

class Termination(enum.Enum):
    """Why an adjustment ended."""

    converged = 0

    iteration_limit = 1

    no_observations = 2

    numerical_failure = 3

class PredictedPose:
    """Gaussian knowledge of a pose before looking."""

    def __init__(
        self,
        *,
        world_from_camera: Transform,
        information: Annotated[NDArray[numpy.float64], dict(shape=(6, 6), order="F")],
    ) -> None:
        """
        information: (6, 6) of the left perturbation (translation m, rotation rad).
        """

class ResectionOptions:
    """Settings of resect."""

    def __init__(self) -> None: ...
    @property
    def loss(self) -> RobustLoss: ...
    @loss.setter
    def loss(self, arg: RobustLoss, /) -> None: ...
    @property
    def max_iterations(self) -> int: ...
    @max_iterations.setter
    def max_iterations(self, arg: int, /) -> None: ...
    @property
    def min_sigma0(self) -> float: ...
    @min_sigma0.setter
    def min_sigma0(self, arg: float, /) -> None: ...
    @property
    def max_sigma0(self) -> float: ...
    @max_sigma0.setter
    def max_sigma0(self, arg: float, /) -> None: ...

class ResectionResult:
    """A pose adjusted to its observations."""

    @property
    def termination(self) -> Termination: ...
    @property
    def camera_from_world(self) -> Transform | None:
        """None when it failed."""

    @property
    def covariance(self) -> Annotated[NDArray[numpy.float64], dict(shape=(6, 6), order="F")]:
        """
        (6, 6) of the left perturbation (translation m, rotation rad) of
        world_from_camera.
        """

    @property
    def sigma0(self) -> float: ...
    @property
    def rms_px(self) -> float: ...
    @property
    def iterations(self) -> int: ...
    @property
    def inlier_count(self) -> int: ...
    @property
    def inlier(self) -> NDArray[numpy.bool_]:
        """(N,) bool, within 3 sigma."""

def resect(
    *,
    points_in_world: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)],
    observed_px: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)],
    stereo: RectifiedStereo,
    camera_from_world: Transform,
    left_sigma_px: float = 1.0,
    right_sigma_px: float = 1.0,
    options: ResectionOptions = ...,
    point_covariances: Annotated[
        NDArray[numpy.float64], dict(shape=(None, 3, 3), order="C", device="cpu", writable=False)
    ]
    | None = None,
    predicted: PredictedPose | None = None,
) -> ResectionResult:
    """
    Robust adjustment of the pose of a rectified pair from `camera_from_world`, to points (N, 3),
    metres, seen at (N, 3) rows of left x, left y, right x (NaN: left only), pixels.
    point_covariances: (N, 3, 3).
    """

def stereo_point_covariances(
    *,
    points_in_left: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)],
    stereo: RectifiedStereo,
    left_sigma_px: float = 1.0,
    right_sigma_px: float = 1.0,
) -> NDArray[numpy.float64]:
    """
    (N, 3, 3) covariances, m^2, of points (N, 3) triangulated from one rectified pair.
    """

class PoseQuality(enum.Enum):
    """Whether a resected pose may be believed."""

    tracking = 0

    degraded = 1

    lost = 2

class AcceptanceRule:
    """When a resected pose may be believed."""

    def __init__(self) -> None: ...
    @property
    def min_inliers(self) -> int: ...
    @min_inliers.setter
    def min_inliers(self, arg: int, /) -> None: ...
    @property
    def min_inlier_share(self) -> float: ...
    @min_inlier_share.setter
    def min_inlier_share(self, arg: float, /) -> None: ...
    @property
    def max_sigma0(self) -> float: ...
    @max_sigma0.setter
    def max_sigma0(self, arg: float, /) -> None: ...
    @property
    def max_rotation_sigma_rad(self) -> float: ...
    @max_rotation_sigma_rad.setter
    def max_rotation_sigma_rad(self, arg: float, /) -> None: ...
    @property
    def max_relative_position_sigma(self) -> float: ...
    @max_relative_position_sigma.setter
    def max_relative_position_sigma(self, arg: float, /) -> None: ...

def judge(
    *, result: ResectionResult, matches: int, median_depth_m: float, rule: AcceptanceRule = ...
) -> PoseQuality:
    """
    Quality of a pose; `matches` went into the search for it, blunders included.
    """

class TwoViews:
    """
    The geometry of two pictures and the depths it gives, the distance of the two being 1.
    """

    @property
    def second_from_first(self) -> Transform: ...
    @property
    def covariance(self) -> Annotated[NDArray[numpy.float64], dict(shape=(5, 5), order="F")]:
        """
        (5, 5): three rotations (left perturbation, rad) and two of the direction, rad.
        """

    @property
    def scale(self) -> float:
        """What the standard errors of the rays must be multiplied with."""

    @property
    def residuals(self) -> NDArray[numpy.float64]:
        """
        (N,) distances of second rays from their epipolar lines, in standard errors.
        """

    @property
    def depths(self) -> NDArray[numpy.float64]:
        """(N,) along z of the first camera, negative where rays meet behind it."""

    @property
    def depth_sigmas_of_pixels(self) -> NDArray[numpy.float64]:
        """(N,) standard errors that the rays leave."""

    @property
    def depth_sigmas_of_motion(self) -> NDArray[numpy.float64]:
        """(N,) standard errors that the motion leaves."""

def refine_two_views(
    *,
    rays_in_first: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)],
    rays_in_second: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)],
    sigma: Annotated[NDArray[numpy.float64], dict(shape=(None, 2), writable=False)],
    second_from_first: Transform,
) -> TwoViews:
    """
    TwoViews of matched rays (N, 3) with z = 1, each in its own camera, from a first guess; sigma
    (N, 2): standard errors of x and y of the second ones. ValueError for lengths that differ and
    fewer than five.
    """

class HomographyOptions:
    """Settings of find_homography."""

    def __init__(self) -> None: ...
    @property
    def threshold_px(self) -> float: ...
    @threshold_px.setter
    def threshold_px(self, arg: float, /) -> None: ...
    @property
    def min_inliers(self) -> int: ...
    @min_inliers.setter
    def min_inliers(self, arg: int, /) -> None: ...
    @property
    def confidence(self) -> float: ...
    @confidence.setter
    def confidence(self, arg: float, /) -> None: ...
    @property
    def max_samples(self) -> int: ...
    @max_samples.setter
    def max_samples(self, arg: int, /) -> None: ...
    @property
    def seed(self) -> int: ...
    @seed.setter
    def seed(self, arg: int, /) -> None: ...

class HomographyResult:
    """The map between two pictures, or none."""

    @property
    def b_from_a(self) -> Annotated[NDArray[numpy.float64], dict(shape=(3, 3), order="F")] | None:
        """
        (3, 3) of homogeneous pixels, last element 1; None where chance explains as much.
        """

    @property
    def inlier(self) -> NDArray[numpy.bool_]:
        """(N,) bool; all false without a map."""

    @property
    def inlier_count(self) -> int: ...
    @property
    def rms_px(self) -> float:
        """Of the inliers, distance in picture b."""

    @property
    def samples(self) -> int: ...

def find_homography(
    *,
    points_a: Annotated[NDArray[numpy.float64], dict(shape=(None, 2), writable=False)],
    points_b: Annotated[NDArray[numpy.float64], dict(shape=(None, 2), writable=False)],
    options: HomographyOptions = ...,
    qualities: Annotated[
        NDArray[numpy.float32], dict(shape=(None,), order="C", device="cpu", writable=False)
    ]
    | None = None,
) -> HomographyResult:
    """
    Map of a plane, or of anything when the camera only turned, between two pictures: samples of
    four, then least squares over all inliers. points: (N, 2) pixels; qualities: (N,) float32,
    larger is better. Raises ValueError for lengths that differ or NaN.
    """

class PosePrior:
    """
    Gaussian knowledge of the first poses: 1/2 d^T information d + gradient^T d, d_i = log(T_i linearisation_i^-1), (translation, rotation).
    """

    def __init__(
        self,
        *,
        world_from_left: Sequence[Transform],
        information: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order="F")],
        gradient: Annotated[NDArray[numpy.float64], dict(shape=(None,), order="C")],
    ) -> None:
        """n linearisation points, (6 n, 6 n) and (6 n,); metres and radians."""

    @property
    def world_from_left(self) -> list[Transform]: ...
    @property
    def information(
        self,
    ) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order="F")]: ...
    @property
    def gradient(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), order="C")]: ...

class BundleProblem:
    """Poses and points to adjust together to what stereo pairs saw."""

    def __init__(
        self,
        *,
        stereo: RectifiedStereo,
        world_from_left: Sequence[Transform],
        pose_is_fixed: Annotated[
            NDArray[numpy.bool_], dict(shape=(None,), order="C", device="cpu", writable=False)
        ],
        points_in_world: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), writable=False)],
        frames: Annotated[
            NDArray[numpy.int32], dict(shape=(None,), order="C", device="cpu", writable=False)
        ],
        points: Annotated[
            NDArray[numpy.int32], dict(shape=(None,), order="C", device="cpu", writable=False)
        ],
        measured_px: Annotated[
            NDArray[numpy.float32], dict(shape=(None, 5), order="C", device="cpu", writable=False)
        ],
    ) -> None:
        """
        F poses with (F,) bool flags, (P, 3) points in metres. Of N observations, points ascending: (N,) int32 frames and points, (N, 5) float32 rows of left x, left y, right x (NaN when unseen), left sigma, right sigma.
        """

    @property
    def world_from_left(self) -> list[Transform]:
        """F poses; copies."""

    @world_from_left.setter
    def world_from_left(self, arg: Sequence[Transform], /) -> None: ...
    @property
    def points_in_world(self) -> NDArray[numpy.float64]:
        """(P, 3), metres; a copy."""

    @property
    def prior(self) -> PosePrior | None:
        """PosePrior on the first frames, or None; a copy."""

    @prior.setter
    def prior(self, prior: PosePrior | None) -> None: ...
    @property
    def observation_count(self) -> int: ...
    @property
    def right_x_offset_px(self) -> float:
        """Constant error of the right picture, added to the predicted right x."""

    @right_x_offset_px.setter
    def right_x_offset_px(self, arg: float, /) -> None: ...
    @property
    def right_x_offset_is_free(self) -> bool: ...
    @right_x_offset_is_free.setter
    def right_x_offset_is_free(self, arg: bool, /) -> None: ...

class BundleResult:
    """How an adjustment went."""

    @property
    def termination(self) -> Termination: ...
    @property
    def iterations(self) -> int: ...
    @property
    def initial_cost(self) -> float:
        """Robust, half sum of squares."""

    @property
    def final_cost(self) -> float: ...
    @property
    def residuals(self) -> int: ...
    @property
    def sigma0(self) -> float:
        """1 when the sigmas given were right."""

    @property
    def unit_variance(self) -> float:
        """What pose_covariances are to be multiplied by, from the residuals."""

    @property
    def normalised_residuals(self) -> NDArray[numpy.float32]:
        """(N,) length of each observation's residual in its sigmas."""

    @property
    def pose_covariances(self) -> NDArray[numpy.float64]:
        """
        (F, 6, 6) of the left perturbation (translation m, rotation rad); empty unless asked.
        """

    @property
    def right_x_offset_sigma_px(self) -> float: ...

class BundleOptions:
    """Settings of adjust_bundle."""

    def __init__(self) -> None: ...
    @property
    def loss(self) -> RobustLoss: ...
    @loss.setter
    def loss(self, arg: RobustLoss, /) -> None: ...
    @property
    def max_iterations(self) -> int: ...
    @max_iterations.setter
    def max_iterations(self, arg: int, /) -> None: ...
    @property
    def relative_cost_change(self) -> float: ...
    @relative_cost_change.setter
    def relative_cost_change(self, arg: float, /) -> None: ...
    @property
    def threads(self) -> int: ...
    @threads.setter
    def threads(self, arg: int, /) -> None: ...
    @property
    def with_covariance(self) -> bool: ...
    @with_covariance.setter
    def with_covariance(self, arg: bool, /) -> None: ...

def adjust_bundle(*, problem: BundleProblem, options: BundleOptions = ...) -> BundleResult:
    """
    Minimise the reprojection error of `problem` in place over its free poses, points and offset.
    """

def marginalize_first_frame(*, problem: BundleProblem, options: BundleOptions = ...) -> None:
    """
    Remove frame 0 and the points it saw from `problem` in place; what they said about the other poses becomes its prior.
    """

class OdometryConfig:
    """Everything that can be set of the odometry, with its defaults."""

    def __init__(self) -> None: ...
    def to_dict(self) -> dict: ...
    @staticmethod
    def from_dict(values: dict) -> OdometryConfig:
        """
        The defaults with `values` changed; ValueError names a bad key or value.
        """

    def __setattr__(self, arg0: str, arg1: object, /) -> None: ...
    @staticmethod
    def describe() -> dict: ...
    @property
    def front_end(self) -> object:
        """how homologous points are found: patch, grid (looking down) or paper"""

    @property
    def points(self) -> object:
        """interest points aimed at in a picture"""

    @property
    def window_keyframes(self) -> object:
        """keyframes adjusted together"""

    @property
    def adjust_every(self) -> object:
        """
        pairs after which a keyframe is made and the window adjusted at the latest
        """

    @property
    def keyframe_parallax_px(self) -> object:
        """median image motion since the last keyframe that makes a new one"""

    @property
    def keyframe_overlap(self) -> object:
        """
        a keyframe is made when fewer than this part of the last one's points are tracked
        """

    @property
    def y_parallax(self) -> object:
        """
        residual that shows blunders: sampson (pixels) or paper_f33 (the paper's equation 3)
        """

    @property
    def loss(self) -> object:
        """robust weights: none, danish, huber, cauchy, tukey, geman_mcclure"""

    @property
    def measurement_sigma_px(self) -> object:
        """standard error of a matched coordinate"""

    @property
    def min_correlation(self) -> object:
        """patches that fit worse are no match"""

    @property
    def max_depth_m(self) -> object:
        """points further away are put there"""

    @property
    def min_inliers(self) -> object:
        """fewer points that fit mean: degraded; fewer than half of it: lost"""

    @property
    def right_x_offset_prior_px(self) -> object:
        """
        how far off, in x, a calibrated right picture may be (1 sigma); the adjustment estimates it; 0 takes the calibration as exact
        """

    @property
    def scale_sigma(self) -> object:
        """
        relative error of base and focal length (1 sigma), part of each covariance
        """

    @property
    def restart_after_s(self) -> object:
        """lost for so long, a new segment is begun where the old one ended"""

    @property
    def threads(self) -> object:
        """threads; results do not depend on it"""

    @property
    def seed(self) -> object:
        """of the random samples"""

class Status(enum.Enum):
    """Whether a pose may be believed."""

    tracking = 0

    degraded = 1

    lost = 2

class Reason(enum.Enum):
    """Why tracking is degraded or lost."""

    none = 0

    too_dark = 1

    blurred = 2

    too_few_points = 3

    no_parallax = 4

    ambiguous = 5

    calibration_does_not_fit = 6

    frames_missing = 7

    left_right_swapped = 8

    left_right_out_of_step = 9

class OdometryResult:
    """What is known of one stereo pair."""

    @property
    def timestamp_ns(self) -> int: ...
    @property
    def status(self) -> Status: ...
    @property
    def reason(self) -> Reason: ...
    @property
    def world_from_left(self) -> Transform | None:
        """
        Pose of the left camera (of the robot when the rig says where it sits); None if lost
        """

    @property
    def covariance(self) -> Annotated[NDArray[numpy.float64], dict(shape=(6, 6), order="F")] | None:
        """
        (6, 6): x y z in metres along the world's axes, rotation in radians about them
        """

    @property
    def segment_covariance(
        self,
    ) -> Annotated[NDArray[numpy.float64], dict(shape=(6, 6), order="F")]:
        """
        The same given the first pose of the segment, without the rig's own errors.
        """

    @property
    def segment(self) -> int: ...
    @property
    def matches(self) -> int: ...
    @property
    def inliers(self) -> int: ...
    @property
    def residual_px(self) -> float: ...
    @property
    def y_parallax_px(self) -> float: ...
    @property
    def is_keyframe(self) -> bool: ...

class CalibrationVerdict(enum.Enum):
    """Whether the rig fits its pictures."""

    unobservable = 0

    consistent = 1

    inconsistent = 2

class CalibrationCheck:
    """Systematic errors of the rig, estimated from the pictures."""

    @property
    def verdict(self) -> CalibrationVerdict: ...
    @property
    def right_x_offset_px(self) -> float: ...
    @property
    def right_x_offset_sigma_px(self) -> float: ...
    @property
    def y_parallax_px(self) -> float: ...
    @property
    def y_parallax_sigma_px(self) -> float: ...

class StereoOdometry:
    """Where a stereo camera goes, from its pictures alone."""

    def __init__(self, *, rig: StereoRig, config: OdometryConfig = ...) -> None: ...
    def track(
        self,
        left: Annotated[
            NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)
        ],
        right: Annotated[
            NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)
        ],
        timestamp_ns: int,
    ) -> OdometryResult:
        """
        Take the next pair, (height, width) uint8 as calibrated; times in ns must rise.
        """

    def skip(self, timestamp_ns: int) -> OdometryResult:
        """A pair that could not be read."""

    def finish(self) -> list[OdometryResult]:
        """Adjust the whole block; a result for every pair given."""

    def live_results(self) -> list[OdometryResult]:
        """What was returned for every pair when it was given."""

    def points(self) -> NDArray[numpy.float32]:
        """(N, 3) points of the scene in the world, metres, after finish()."""

    def point_greys(self) -> NDArray[numpy.uint8]:
        """(N,) uint8 grey value of each point."""

    def calibration_check(self) -> CalibrationCheck:
        """What the pictures say of the rig's systematic errors so far."""

    @property
    def adjustment_cpu_ms(self) -> float: ...

class JudgeConfig:
    """Everything that can be set of the judge, with its defaults."""

    def __init__(self) -> None: ...
    def to_dict(self) -> dict: ...
    @staticmethod
    def from_dict(values: dict) -> JudgeConfig:
        """
        The defaults with `values` changed; ValueError names a bad key or value.
        """

    def __setattr__(self, arg0: str, arg1: object, /) -> None: ...
    @staticmethod
    def describe() -> dict: ...
    @property
    def rule(self) -> object:
        """chi_square: join by covariance; paper: choose by m_q"""

    @property
    def window_s(self) -> object:
        """motions over so long are compared; longer sees smaller faults, later"""

    @property
    def confidence(self) -> object:
        """part of sound motions that passes the chi-square test"""

    @property
    def paper_limit_m(self) -> object:
        """paper: dX, dY or dZ may differ from the calibrated value by so much"""

    @property
    def rejoin_s(self) -> object:
        """what was set aside is believed again after agreeing for so long"""

    @property
    def scale_sigma(self) -> object:
        """
        relative error of lengths that all pairs share (1 sigma), part of each covariance
        """

    @property
    def stamp_sigma_s(self) -> object:
        """how far off the time stamps of two pairs may be (1 sigma)"""

class Belief(enum.Enum):
    """What the judge makes of one stereo pair at an instant."""

    joined = 0
    """Believed."""

    disagrees = 1
    """Moves otherwise than the others; by the paper's rule: is not chosen."""

    lost = 2
    """Gives no pose; its reason says why."""

    absent = 3
    """Gives no pictures."""

class PairVerdict:
    """What one stereo pair contributes at an instant."""

    @property
    def belief(self) -> Belief: ...
    @property
    def status(self) -> Status: ...
    @property
    def reason(self) -> Reason: ...
    @property
    def m_q(self) -> float: ...
    @property
    def difference(self) -> Annotated[NDArray[numpy.float64], dict(shape=(6), order="C")]:
        """
        (6,): motion over the window against that of the others, in the robot's frame: metres, then radians.
        """

    @property
    def chi_square(self) -> float:
        """Of it; 6 degrees of freedom."""

class JointResult:
    """The joint trajectory at an instant."""

    @property
    def timestamp_ns(self) -> int: ...
    @property
    def status(self) -> Status: ...
    @property
    def world_from_robot(self) -> Transform | None:
        """None if lost."""

    @property
    def covariance(self) -> Annotated[NDArray[numpy.float64], dict(shape=(6, 6), order="F")] | None:
        """
        (6, 6): x y z in metres along the world's axes, rotation in radians about them.
        """

    @property
    def segment(self) -> int: ...
    @property
    def pairs(self) -> list[PairVerdict]: ...

class Judge:
    """Compares the trajectories of a robot's stereo pairs and joins them."""

    def __init__(self, *, pairs: int, config: JudgeConfig = ...) -> None: ...
    def add(self, pair: int, result: OdometryResult) -> list[JointResult]:
        """
        Take what a pair's odometry said (OdometryResult of the robot); return the JointResults that it decides. ValueError when times do not rise.
        """

    def finish(self) -> list[JointResult]:
        """Return the JointResults that still wait for other pairs."""

    def again(self) -> Judge:
        """
        Return a Judge of the adjusted results of the same drive, who knows whom this one set aside and when: an adjustment spreads a sudden fault until it looks like motion.
        """

    def set_aside(self) -> list[bool]:
        """
        Return a bool for each pair: contradicted by the others to the end. Join what such a pair said at the time, for its adjusted path is spoilt from its beginning.
        """

class ReconstructionConfig:
    """Everything that can be set of a reconstruction."""

    def __init__(self) -> None: ...
    def to_dict(self) -> dict: ...
    @staticmethod
    def from_dict(values: dict) -> ReconstructionConfig:
        """
        The defaults with `values` changed; ValueError names a bad key or value.
        """

    def __setattr__(self, arg0: str, arg1: object, /) -> None: ...
    @staticmethod
    def describe() -> dict: ...
    @property
    def features(self) -> object:
        """features kept of a picture, the strongest"""

    @property
    def uses_dog(self) -> object:
        """blobs: extrema of differences of Gaussians"""

    @property
    def uses_harris(self) -> object:
        """corners, on a pyramid"""

    @property
    def uses_fast_hessian(self) -> object:
        """blobs: determinants of Hessians of box filters"""

    @property
    def uses_mser(self) -> object:
        """maximally stable extremal regions"""

    @property
    def is_oriented(self) -> object:
        """descriptors turn with what they show: for cameras that roll"""

    @property
    def neighbours(self) -> object:
        """pictures most alike that each picture is matched with"""

    @property
    def sequence_neighbours(self) -> object:
        """of ordered pictures: so many that follow are matched as well"""

    @property
    def max_ratio(self) -> object:
        """descriptors of a match: distance over that of the second best, at most"""

    @property
    def feature_sigma_px(self) -> object:
        """standard error of a feature's coordinates at the finest scale"""

    @property
    def focal_sigma(self) -> object:
        """
        relative standard error of the focal length given; 0: it is right, more: a better one is looked for
        """

    @property
    def lens_sigma(self) -> object:
        """
        standard error of the calibration of pictures without distortion, as a part of pixels' distances from the centre: a radial distortion that was left is looked for, and taken from 1 px in the corners on; 0: there is none
        """

    @property
    def min_pair_inliers(self) -> object:
        """matches that must agree on the geometry of two pictures"""

    @property
    def motions(self) -> object:
        """
        rigid motions looked for between two pictures: 2 where somebody walks about
        """

    @property
    def min_track_length(self) -> object:
        """pictures that must show a point"""

    @property
    def min_angle_deg(self) -> object:
        """least angle between the rays of a point"""

    @property
    def outlier_sigma(self) -> object:
        """
        an observation further from its point, in standard errors, is an outlier
        """

    @property
    def min_pose_inliers(self) -> object:
        """points that must agree on the pose of a picture"""

    @property
    def loss(self) -> object:
        """robust weights: none, danish, huber, cauchy, tukey, geman_mcclure"""

    @property
    def threads(self) -> object:
        """worker threads; the result is the same for any"""

    @property
    def seed(self) -> object:
        """of the random samples"""

class PictureFate(enum.Enum):
    """What became of a picture of a reconstruction."""

    posed = 0
    """Its pose is known."""

    few_features = 1
    """A blank wall, darkness or blur."""

    no_matches = 2
    """Shows nothing that another picture shows."""

    no_parallax = 3
    """
    All it shares with others was seen from one place: a turn is not enough.
    """

    not_connected = 4
    """Matched, but too little of it is in the model."""

    other_camera = 5
    """Asks for another focal length than the other pictures."""

class Reconstruction:
    """
    Poses and points up to one similarity: the world is the camera of the first posed picture, the unit the rms distance of the cameras from their middle.
    """

    @property
    def camera_from_world(self) -> list[Transform | None]:
        """One a picture, None where it has no pose."""

    @property
    def fates(self) -> list[PictureFate]:
        """PictureFate, one a picture."""

    @property
    def fates_if_unposed(self) -> list[PictureFate]:
        """PictureFate, one a picture: what it would be, had it no pose."""

    @property
    def bent_pictures(self) -> list[int]:
        """
        Posed pictures, ascending, that fit each other clearly better than the model: its shape is wrong there.
        """

    @property
    def points_in_world(self) -> NDArray[numpy.float64]:
        """(N, 3)."""

    @property
    def greys(self) -> NDArray[numpy.uint8]:
        """(N,) uint8, brightness of each point."""

    @property
    def view_pictures(self) -> NDArray[numpy.int32]:
        """(M,) picture of each observation, grouped by point."""

    @property
    def view_points(self) -> NDArray[numpy.int32]:
        """(M,) point of each observation, ascending."""

    @property
    def view_px(self) -> NDArray[numpy.float32]:
        """(M, 2) pixel of each observation."""

    @property
    def view_residuals_px(self) -> NDArray[numpy.float32]:
        """(M,) distance of each observation from its point, in the ideal camera."""

    @property
    def rms_px(self) -> float:
        """Of the residuals in x and y."""

    @property
    def focal_px(self) -> float:
        """
        Of the first camera; a better one than given where config.focal_sigma > 0, or a distortion was left in the calibration.
        """

    @property
    def radial(self) -> float:
        """
        First coefficient of Brown's distortion that the calibration left; 0 where none was found.
        """

    @property
    def corner_shift_px(self) -> float:
        """By how much `radial` moves the pictures' farthest corner."""

    @property
    def focal_sigma_px(self) -> float:
        """Its standard error, 0 if it was not looked for."""

    @property
    def feature_count(self) -> int: ...
    @property
    def pair_count(self) -> int:
        """Pairs of pictures with a geometry."""

    @property
    def track_count(self) -> int: ...

def reconstruct(
    *,
    pictures: Sequence[
        Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)]
    ],
    cameras: Sequence[Camera],
    camera_of_picture: Sequence[int],
    is_ordered: bool,
    config: ReconstructionConfig = ...,
) -> Reconstruction:
    """
    Structure from motion of (height, width) uint8 pictures by calibrated cameras; camera_of_picture[i] is an index into cameras. The order of the pictures does not change the model. ValueError for contradictory input; what cannot be solved is in `fates`.
    """

class MarkSighting:
    """A square mark as a picture shows it."""

    def __init__(
        self,
        *,
        picture: int,
        mark: int,
        rays: Sequence[Annotated[NDArray[numpy.float64], dict(shape=(3), order="C")]],
        sigma_rad: float,
    ) -> None:
        """
        Number of the picture and of the mark; rays: (3,) unit, in the camera, of its four corners one after another; sigma_rad: of each along either axis.
        """

    @property
    def picture(self) -> int: ...
    @property
    def mark(self) -> int: ...

class MarkAccount:
    """Squares in pictures, all with a side of one length."""

    def __init__(
        self, *, sightings: Sequence[MarkSighting], side_m: float, side_sigma_m: float
    ) -> None: ...
    @property
    def sightings(self) -> list[MarkSighting]: ...

def mark_length(
    *, marks: MarkAccount, camera_from_world: Sequence[Transform | None]
) -> LengthEstimate | None:
    """
    By what marks ask a model's lengths to be multiplied, None where they say nothing. camera_from_world: of each picture, None without a pose. Throws ValueError.
    """

class StepAccount:
    """How a robot believes to have come from the stop before to this one."""

    def __init__(
        self,
        *,
        previous_from_stop: Transform,
        covariance: Annotated[NDArray[numpy.float64], dict(shape=(6, 6), order="F")],
    ) -> None:
        """
        covariance: (6, 6) of the place in the former stop's axes, m, and the turn about its own axes, rad.
        """

class WalkAccount:
    """
    What a robot that stops, looks around and walks on tells of its pictures; the frame of a stop is the robot's there, on the ground.
    """

    def __init__(
        self,
        *,
        stop_of_picture: Sequence[int],
        stop_from_camera: Sequence[Transform],
        joint_covariances: Sequence[
            Annotated[NDArray[numpy.float64], dict(shape=(6, 6), order="F")]
        ],
        steps: Sequence[StepAccount | None],
        common_step_sigma: float = 0.05,
        height_sigma_m: float = 0.005,
        marks: MarkAccount = ...,
    ) -> None:
        """
        Of each picture: its stop, ascending from 0, where its camera was in the stop by the joints, and the (6, 6) covariance of that (place in the stop's axes, turn about the camera's own). Of each stop: its step, None for the first and where none is known. common_step_sigma: part of a length by which all steps err alike; height_sigma_m: of the cameras above the floor, by the legs; marks: squares of known side in the pictures.
        """

class StopFate(enum.Enum):
    """What became of a stop of a walk."""

    placed = 0
    """Its step and its pictures agree."""

    carried = 1
    """Its pictures say where it is, and that no step led there."""

    found = 2
    """
    Its pictures say where it is; the stop before is lost, so how it came is not known.
    """

    lost = 3
    """What its pictures show could not be found in what is known."""

class PlacedStop:
    """A stop of a walk and where it is."""

    @property
    def fate(self) -> StopFate: ...
    @property
    def world_from_stop(self) -> Transform | None:
        """None where it is lost."""

    @property
    def covariance(self) -> Annotated[NDArray[numpy.float64], dict(shape=(6, 6), order="F")]:
        """
        (6, 6) of the place and of the turn about the world's axes, against the first stop.
        """

    @property
    def sights(self) -> int:
        """Observations of places that hold it."""

    @property
    def set_aside(self) -> int:
        """Features that other stops show as well and that contradict the room."""

class LengthSource(enum.Enum):
    """What tells how long a metre is in a model."""

    joints = 0
    """The cameras' offsets while the head turns and the legs crouch."""

    steps = 1
    """The way from stop to stop as the robot believes it."""

    ground = 2
    """The cameras' height above the floor they see."""

    marks = 3
    """Squares of a known side."""

class LengthEstimate:
    """By what a model's lengths are to be multiplied, by one source."""

    @property
    def source(self) -> LengthSource: ...
    @property
    def factor(self) -> float: ...
    @property
    def sigma(self) -> float: ...
    @property
    def count(self) -> int:
        """Pictures, steps, places or marks it comes from."""

class WalkReconstruction:
    """
    A model in metres; its world is the robot's frame at the first stop that has a pose.
    """

    @property
    def model(self) -> Reconstruction: ...
    @property
    def stops(self) -> list[PlacedStop]:
        """PlacedStop, one a stop."""

    @property
    def lengths(self) -> list[LengthEstimate]:
        """LengthEstimate of each source, of the model as adjusted."""

    @property
    def length_factor(self) -> float:
        """Their mean, which the model has been multiplied by."""

    @property
    def length_sigma(self) -> float:
        """Its standard error."""

def reconstruct_walk(
    *,
    pictures: Sequence[
        Annotated[NDArray[numpy.uint8], dict(shape=(None, None), device="cpu", writable=False)]
    ],
    cameras: Sequence[Camera],
    camera_of_picture: Sequence[int],
    account: WalkAccount,
    config: ReconstructionConfig = ...,
) -> WalkReconstruction:
    """
    Structure from motion of (height, width) uint8 pictures of a robot that stops, looks around and walks on. ValueError for contradictory input.
    """

class SurfaceLayer:
    """One octave band of a surface's brightness."""

    def __init__(
        self,
        *,
        exemplar: int,
        amplitude: float,
        texel_m: float,
        seed: int = 0,
        has_grain: bool = False,
    ) -> None:
        """
        exemplar: index in the scene; amplitude: albedo per unit of it; texel_m: metres; has_grain: has a direction of its own, so is never turned.
        """

class Material:
    """How a shape looks: (albedo + layers) times colour times texture."""

    def __init__(
        self,
        *,
        albedo: float = 0.5,
        colour: Sequence[float] = [1.0, 1.0, 1.0],
        layers: Sequence[SurfaceLayer] = [],
        checker_m: float = 0.0,
        dark_albedo: float = 0.05000000074505806,
        texture: int = -1,
    ) -> None:
        """
        colour: red, green, blue factors; checker_m: side of squares, metres, 0 for none; texture: index in the scene, -1 for none.
        """

class ShapeKind(enum.Enum):
    """Shapes of MuJoCo's geoms."""

    plane = 0

    height_field = 1

    sphere = 2

    capsule = 3

    ellipsoid = 4

    cylinder = 5

    box = 6

    mesh = 7

class Scene:
    """What rendered cameras look at. Each add_ returns an index."""

    def __init__(self) -> None: ...
    def add_exemplar(
        self,
        values: Annotated[
            NDArray[numpy.float32],
            dict(shape=(None, None), order="C", device="cpu", writable=False),
        ],
    ) -> int:
        """
        A (side, side) float32 sample of a texture in [-1, 1] that wraps around.
        """

    def add_texture(
        self,
        texels: Annotated[
            NDArray[numpy.uint16],
            dict(shape=(None, None, None, 3), order="C", device="cpu", writable=False),
        ],
    ) -> int:
        """
        Red, green, blue (faces, H, W, 3) uint16, 65535 for white, rows from the top: one face that repeats, or a cube's +x, -x, +y, -y, +z, -z as OpenGL lays them.
        """

    def add_material(self, material: Material) -> int: ...
    def add_height_field(
        self,
        *,
        heights_m: Annotated[
            NDArray[numpy.float32],
            dict(shape=(None, None), order="C", device="cpu", writable=False),
        ],
        half_x_m: float,
        half_y_m: float,
    ) -> int:
        """
        Heights (rows, columns) float32, rows from -y, columns from -x, metres.
        """

    def add_mesh(
        self,
        *,
        vertices_m: Annotated[
            NDArray[numpy.float32], dict(shape=(None, 3), order="C", device="cpu", writable=False)
        ],
        faces: Annotated[
            NDArray[numpy.int32], dict(shape=(None, 3), order="C", device="cpu", writable=False)
        ],
        texture: Annotated[
            NDArray[numpy.float32], dict(shape=(None, 2), order="C", device="cpu", writable=False)
        ]
        | None = None,
    ) -> int:
        """
        Vertices (N, 3) float32, metres, and faces (M, 3) int32; texture: (N, 2) float32, their places in a texture in repeats of it, from the left and from the top.
        """

    def add_shape(
        self,
        *,
        kind: ShapeKind,
        size_m: Sequence[float],
        material: int,
        world_from_shape: Transform,
        data: int = -1,
        texture_scale: Sequence[float] = [1.0, 1.0, 1.0],
    ) -> int:
        """
        Sizes as MuJoCo's geom; data: which height field or mesh; texture_scale: repeats of a texture over the shape (a metre of height fields, endless planes and meshes without places), of a cube's the scale of the directions. Throws ValueError.
        """

    def set_light(
        self,
        *,
        to_sun: Sequence[float],
        sun: float,
        sky: float,
        background: float,
        sky_slope: float = 0.4000000059604645,
        lamps: Sequence[tuple[Sequence[float], float]] = [],
    ) -> None:
        """
        Direction to the sun, and the radiance of a white surface by sun and by sky; sky_slope: part of the latter that depends on facing up; lamps: position_m and the radiance of a white surface one metre away.
        """

class CameraRays:
    """Rays of a camera's pixels through its lens model."""

    def __init__(self, camera: Camera) -> None: ...

class RowExposure:
    """Where a camera was while one row was exposed."""

    @overload
    def __init__(self, world_from_camera: Transform) -> None:
        """It stood still."""

    @overload
    def __init__(self, *, begin: Transform, middle: Transform, end: Transform) -> None:
        """world_from_camera; it moves evenly."""

class ShapeMotion:
    """Where a shape is while the shutter is open."""

    def __init__(self, shape: int, *, begin: Transform, end: Transform) -> None:
        """
        world_from_shape when the first row's exposure begins and when the last row's ends; it moves evenly.
        """

class ShutterPoses:
    """What happens while the shutter is open."""

    @overload
    def __init__(self, world_from_camera: Transform) -> None:
        """All stand still."""

    @overload
    def __init__(
        self,
        *,
        first: RowExposure,
        last: RowExposure | None = None,
        exposed_share: float = 1.0,
        moving: Sequence[ShapeMotion] = [],
    ) -> None:
        """
        Where the camera is while the first and the last row are exposed, the same for a global shutter; for which part of the time between the first's begin and the last's end a row is exposed; what moves meanwhile.
        """

def render(
    scene: Scene,
    camera: CameraRays,
    poses: ShutterPoses,
    *,
    channels: int = 1,
    threads: int = 1,
    edge_samples: int = 32,
    with_depth: bool = True,
) -> dict:
    """
    Return radiance (H, W) or (H, W, 3) float32, depth_m (H, W), 0 where nothing is hit, and shape (H, W), -1 there. radiance is the mean over the exposure, depth_m and shape are of its middle, and left out without with_depth. Throws ValueError.
    """

def expose(
    light: Annotated[NDArray[numpy.float32], dict(order="C", device="cpu", writable=False)],
    sensitivity: Annotated[NDArray[numpy.float32], dict(order="C", device="cpu", writable=False)],
    *,
    grey: float,
    read_noise: float,
    shot_noise2: float,
    seed: int,
) -> object:
    """
    Return the uint8 picture of `light` times `sensitivity` (float32 of one shape). grey: value of radiance 1; read_noise: standard deviation; shot_noise2: variance of light's noise over its grey value; each value's noise follows from seed and place.
    """
