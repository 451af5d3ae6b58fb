// SPDX-License-Identifier: Apache-2.0
#include "estimation/bundle_layout.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

constexpr int kChunkPoints = 128;
constexpr int kChunkObservations = 1024;
/// Bounds the chunk's own reduced system (blocks grow with the square).
constexpr int kChunkPoses = 48;

/// `what` makes the message, so that it costs nothing while all is well.
template <typename Message>
void require(bool holds, const Message& what) {
  if (!holds) throw std::invalid_argument(what());
}

std::string text(double value) { return std::to_string(value); }

void check_prior(const PosePrior& prior, std::size_t frames) {
  const Eigen::Index n = static_cast<Eigen::Index>(prior.world_from_left.size());
  require(prior.world_from_left.size() <= frames, [&] {
    return "prior has " + std::to_string(n) + " poses, more than the " + std::to_string(frames) +
           " of the problem";
  });
  require(prior.information.rows() == 6 * n && prior.information.cols() == 6 * n &&
              prior.gradient.size() == 6 * n,
          [&] {
            return "prior information must be (6 n, 6 n) and its gradient (6 n) for n = " +
                   std::to_string(n) + " poses";
          });
}

void check_values(const BundleProblem& problem) {
  const RectifiedStereo& stereo = problem.stereo;
  require(stereo.focal_px > 0 && std::isfinite(stereo.focal_px + stereo.baseline_m), [&] {
    return "stereo must have focal_px > 0 and a finite baseline_m, got " + text(stereo.focal_px) +
           " and " + text(stereo.baseline_m);
  });
  for (std::size_t f = 0; f < problem.world_from_left.size(); ++f) {
    const Transform& pose = problem.world_from_left[f];
    require(pose.translation.allFinite() && pose.rotation.coeffs().allFinite(),
            [&] { return "world_from_left[" + std::to_string(f) + "] is not finite"; });
  }
  for (std::size_t p = 0; p < problem.points_in_world.size(); ++p) {
    require(problem.points_in_world[p].allFinite(),
            [&] { return "points_in_world[" + std::to_string(p) + "] is not finite"; });
  }
}

void check_observations(const BundleProblem& problem) {
  const int frames = static_cast<int>(problem.world_from_left.size());
  const int points = static_cast<int>(problem.points_in_world.size());
  int previous = 0;
  for (const StereoObservation& seen : problem.observations) {
    require(seen.frame >= 0 && seen.frame < frames, [&] {
      return "observation of frame " + std::to_string(seen.frame) + ", outside 0 to " +
             std::to_string(frames - 1);
    });
    require(seen.point >= previous && seen.point < points, [&] {
      return "observation of point " + std::to_string(seen.point) + " after point " +
             std::to_string(previous) + ": must ascend and stay below " + std::to_string(points);
    });
    require(seen.left_sigma_px > 0 && seen.right_sigma_px > 0, [&] {
      return "sigmas must be > 0 px, got " + text(seen.left_sigma_px) + " and " +
             text(seen.right_sigma_px);
    });
    previous = seen.point;
  }
}

void check_links(const BundleProblem& problem) {
  const int frames = static_cast<int>(problem.world_from_left.size());
  for (const PoseLink& link : problem.links) {
    for (const int end : {link.a, link.b}) {
      require(end >= 0 && end < frames && link.a != link.b, [&] {
        return "link from frame " + std::to_string(link.a) + " to " + std::to_string(link.b) +
               ": must be two of 0 to " + std::to_string(frames - 1);
      });
    }
    require(link.a_from_b.translation.allFinite() && link.a_from_b.rotation.coeffs().allFinite() &&
                link.information.allFinite(),
            [&] {
              return "link from frame " + std::to_string(link.a) + " to " + std::to_string(link.b) +
                     " is not finite";
            });
  }
}

void check(const BundleProblem& problem) {
  const std::size_t frames = problem.world_from_left.size();
  require(problem.pose_is_fixed.size() == frames, [&] {
    return "pose_is_fixed has " + std::to_string(problem.pose_is_fixed.size()) + " entries for " +
           std::to_string(frames) + " poses";
  });
  if (const auto& known = problem.focal_prior) {
    require(!problem.right_x_offset_is_free,
            [] { return "one of focal length and right_x_offset_px must be known"; });
    require(known->focal_px > 0 && known->sigma_px > 0, [&] {
      return "focal_prior must be > 0 px in both, got " + text(known->focal_px) + " and " +
             text(known->sigma_px);
    });
  }
  check_values(problem);
  check_observations(problem);
  check_links(problem);
  if (problem.prior) check_prior(*problem.prior, frames);
}

std::vector<int> starts_of_points(const BundleProblem& problem) {
  std::vector<int> start(problem.points_in_world.size() + 1, 0);
  for (const StereoObservation& seen : problem.observations) ++start[seen.point + 1];
  std::partial_sum(start.begin(), start.end(), start.begin());
  return start;
}

/// Counting sort by first frame; points without observations are left out.
std::vector<int> order_by_first_frame(const BundleProblem& problem, const std::vector<int>& start) {
  const int points = static_cast<int>(problem.points_in_world.size());
  std::vector<int> first(points), rank(problem.world_from_left.size() + 1, 0);
  for (int p = 0; p < points; ++p) {
    if (start[p] == start[p + 1]) continue;
    const auto earlier = [](const StereoObservation& a, const StereoObservation& b) {
      return a.frame < b.frame;
    };
    first[p] = std::min_element(problem.observations.begin() + start[p],
                                problem.observations.begin() + start[p + 1], earlier)
                   ->frame;
    ++rank[first[p] + 1];
  }
  std::partial_sum(rank.begin(), rank.end(), rank.begin());
  std::vector<int> order(rank.back());
  for (int p = 0; p < points; ++p) {
    if (start[p] < start[p + 1]) order[rank[first[p]]++] = p;
  }
  return order;
}

/// Puts points, taken in order, into chunks.
class ChunkBuilder {
 public:
  ChunkBuilder(int free_poses, std::vector<PointChunk>& chunks)
      : chunks_(chunks), is_in_chunk_(free_poses, 0) {}

  void add(const std::vector<int>& poses, int observations) {
    const auto added =
        std::count_if(poses.begin(), poses.end(), [this](int pose) { return !is_in_chunk_[pose]; });
    if (chunk_.end - chunk_.begin >= kChunkPoints ||
        chunk_.observations + observations > kChunkObservations ||
        static_cast<int>(chunk_.free_poses.size() + added) > kChunkPoses) {
      close();
    }
    for (const int pose : poses) {
      if (!is_in_chunk_[pose]) chunk_.free_poses.push_back(pose);
      is_in_chunk_[pose] = 1;
    }
    ++chunk_.end;
    chunk_.observations += observations;
  }
  void close() {
    std::sort(chunk_.free_poses.begin(), chunk_.free_poses.end());
    for (const int pose : chunk_.free_poses) is_in_chunk_[pose] = 0;
    const int end = chunk_.end;
    if (chunk_.begin < end) chunks_.push_back(std::move(chunk_));
    chunk_ = PointChunk{end, end, 0, {}};
  }

 private:
  std::vector<PointChunk>& chunks_;
  std::vector<char> is_in_chunk_;
  PointChunk chunk_;
};

}  // namespace

BundleLayout::BundleLayout(const BundleProblem& problem) {
  check(problem);
  for (std::size_t f = 0; f < problem.world_from_left.size(); ++f) {
    free_index.push_back(problem.pose_is_fixed[f] ? -1 : static_cast<int>(free_frames.size()));
    if (!problem.pose_is_fixed[f]) free_frames.push_back(static_cast<int>(f));
  }
  point_start = starts_of_points(problem);
  order = order_by_first_frame(problem, point_start);
  first_row.resize(free_frames.size());
  std::iota(first_row.begin(), first_row.end(), 0);

  ChunkBuilder builder(static_cast<int>(free_frames.size()), chunks);
  std::vector<int> poses;  // of one point
  for (const int p : order) {
    poses.clear();
    for (int o = point_start[p]; o < point_start[p + 1]; ++o) {
      const int pose = free_index[problem.observations[o].frame];
      if (pose >= 0) poses.push_back(pose);
    }
    const int top = poses.empty() ? 0 : *std::min_element(poses.begin(), poses.end());
    for (const int pose : poses) first_row[pose] = std::min(first_row[pose], top);
    builder.add(poses, point_start[p + 1] - point_start[p]);
  }
  builder.close();
  for (const PoseLink& link : problem.links) {
    const auto [top, bottom] = std::minmax(free_index[link.a], free_index[link.b]);
    if (top >= 0) first_row[bottom] = std::min(first_row[bottom], top);
  }
  if (!problem.prior) return;
  for (std::size_t f = 0; f < problem.prior->world_from_left.size(); ++f) {
    if (free_index[f] >= 0) first_row[free_index[f]] = 0;
  }
}

}  // namespace pilotage
