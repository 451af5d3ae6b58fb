// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "estimation/pose_link.hpp"
#include "estimation/robust_loss.hpp"
#include "geometry/camera.hpp"

namespace pilotage {

/// One point seen in one rectified pair.
struct StereoObservation {
  int frame = 0;
  int point = 0;
  float left_x_px = 0, left_y_px = 0;
  float right_x_px = 0;  ///< NaN when the right camera did not see it
  float left_sigma_px = 1;
  float right_sigma_px = 1;
};

/// Gaussian knowledge of the first `frames` poses of a problem, left by what was marginalised.
/// Cost: 1/2 d^T information d + gradient^T d with d_i = log(T_i linearisation_i^-1), T_i =
/// world_from_left, a perturbation on the left: global motion is then the same shift of every d_i
/// wherever the poses are, so the prior never invents knowledge of it.
struct PosePrior {
  std::vector<Transform> world_from_left;  ///< linearisation points
  Eigen::MatrixXd information;             ///< (6 n, 6 n)
  Eigen::VectorXd gradient;                ///< (6 n)
};

/// What is known of a focal length before the pictures are asked.
struct FocalPrior {
  double focal_px = 0;
  double sigma_px = 0;  ///< its standard error, > 0
};

/// Poses and points to adjust together. Observations are grouped by point (ascending).
struct BundleProblem {
  RectifiedStereo stereo;
  std::vector<Transform> world_from_left;
  std::vector<char> pose_is_fixed;  ///< same length
  std::vector<Eigen::Vector3d> points_in_world;
  std::vector<StereoObservation> observations;
  std::optional<PosePrior> prior;  ///< on the first frames
  std::vector<PoseLink> links;     ///< between any frames; one need not see a point
  /// Constant error of the right picture in x (adds to the predicted right_x), an unknown if asked.
  double right_x_offset_px = 0;
  bool right_x_offset_is_free = false;
  /// When given, stereo.focal_px is an unknown as well, and this what was known of it; the offset
  /// must then be known.
  std::optional<FocalPrior> focal_prior;
};

struct BundleOptions {
  /// Weighs whole observations: by the length of their normalised residual over the square root of
  /// its components (3, or 2 without the right picture).
  RobustLoss loss = RobustLoss::huber;
  int max_iterations = 10;
  double relative_cost_change = 1e-4;  ///< converged below this
  int threads = 1;
  bool with_covariance = false;
};

enum class Termination { converged, iteration_limit, no_observations, numerical_failure };

struct BundleResult {
  Termination termination = Termination::no_observations;
  int iterations = 0;
  double initial_cost = 0, final_cost = 0;  ///< robust cost, half sum of squares
  int residuals = 0;
  /// Robust estimate of the normalised residuals' sigma, 1 when the sigmas given were right: 1.4826
  /// times the median absolute component, enlarged by sqrt(n / (n - u)) for the u unknowns that
  /// took up some of the n components.
  double sigma0 = 1;
  /// Normalised residual length of each observation at the end; 1000 when the point cannot be
  /// predicted (behind the camera, or a pixel that is NaN): such an observation has no weight.
  std::vector<float> normalised_residuals;
  /// Covariance of each pose for the left perturbation (translation, rotation), when asked for;
  /// zero for fixed poses, about 1e8 where nothing is known. Not scaled by `unit_variance`.
  std::vector<Matrix6d> pose_covariances;
  /// What the covariances are to be multiplied by when the sigmas given are not believed: the
  /// asymptotic variance of an M-estimator (Huber 1981, section 7.6) over that of the weighted
  /// normal equations, from the residuals. Unlike sigma0 it knows of heavy tails. 1 when the sigmas
  /// were right, a little more for the efficiency that the robust loss gives away.
  double unit_variance = 1;
  double right_x_offset_sigma_px = 0;  ///< standard error, when it was free
  double focal_sigma_px = 0;           ///< likewise of the focal length
};

/// Minimises reprojection error over the free poses, the points and the offset or focal length, in
/// place.
///
/// Schur-complement Levenberg-Marquardt (Triggs et al. 2000): points are eliminated one by one, the
/// reduced camera system is sparse (block profile Cholesky), so cost grows linearly with the length
/// of a path. The result has the same bits for any number of threads. Unknowns that nothing
/// determines stay where they are; a point whose step would pass a camera that sees it goes along
/// with that camera. Throws std::invalid_argument when the problem contradicts
/// itself.
BundleResult adjust_bundle(BundleProblem& problem, const BundleOptions& options);

/// BundleResult::pose_covariances of a problem whose poses and points are adjusted already.
std::vector<Matrix6d> pose_covariances(const BundleProblem& problem, const BundleOptions& options);

/// Removes frame 0 and every point it sees from the problem (without links); what they said about
/// the other poses becomes the new prior (replacing the old one, which is folded in), linearised
/// where the poses are now, with robust weights of now. Call it on an adjusted problem. If frame 0
/// was fixed, the others are then known relative to it. A free offset is eliminated: what was
/// learnt of it is given up; the focal length must be known.
void marginalize_first_frame(BundleProblem& problem, const BundleOptions& options);

}  // namespace pilotage
