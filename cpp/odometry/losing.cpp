// SPDX-License-Identifier: Apache-2.0
// The part of StereoOdometry that deals with pairs that give no pose.
#include "odometry/pair_check.hpp"
#include "odometry/seconds.hpp"
#include "odometry/stereo_odometry.hpp"

namespace pilotage {

bool StereoOdometry::right_disagrees(const Tracked& tracked) const {
  const bool is_suspected =
      !records_.empty() && records_.back().result.reason == Reason::left_right_out_of_step;
  return disagrees(tracked.step, is_suspected);
}

/// Whether the pair itself is at fault, not what it shows.
Reason StereoOdometry::examine(const PyramidPair& pair, const PyramidPair& exchanged,
                               const Tracked& tracked) const {
  PairEvidence evidence{sample_rows(pair, stereo_), sample_rows(exchanged, stereo_), true};
  // A right picture that shows little can be out of step or dark: only a clear one tells.
  evidence.right_agrees =
      tracked.step.inliers < config_.min_inliers || !right_disagrees(tracked) ||
      explain_few_points(describe_picture(*pair.right), usual_sharpness_) != Reason::too_few_points;
  return find_pair_fault(evidence);
}

/// Nothing of a faulty pair is used, and nothing can be begun with it.
OdometryResult StereoOdometry::refuse(const Tracked& tracked, std::int64_t timestamp_ns,
                                      Reason fault) {
  ++lost_pairs_;
  OdometryResult& result = record_lost(timestamp_ns, fault);
  result.matches = static_cast<int>(tracked.matches.size());
  result.inliers = tracked.step.inliers;
  return result;
}

OdometryResult StereoOdometry::lose(const PyramidPair& pair, const Tracked& tracked) {
  const double gap_s = seconds_between(previous_timestamp_ns_, pair.timestamp_ns);
  if (gap_s > config_.restart_after_s) {
    window_.clear(block_);
    return start(pair);
  }
  const Reason reason = explain_few_points(describe_picture(*pair.left), usual_sharpness_);
  const bool is_unexplained = reason == Reason::too_few_points;
  return refuse(tracked, pair.timestamp_ns,
                is_unexplained && is_repeating_ ? Reason::ambiguous : reason);
}

OdometryResult& StereoOdometry::record_lost(std::int64_t timestamp_ns, Reason reason) {
  PairRecord& record = records_.emplace_back();
  record.result.timestamp_ns = timestamp_ns;
  record.result.reason = reason;
  record.result.segment = segment_;
  return record.result;
}

}  // namespace pilotage
