// SPDX-License-Identifier: Apache-2.0
#include "odometry/judge.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "config_fields.hpp"

namespace pilotage {

template <>
struct Names<JudgeRule> {
  static constexpr std::pair<JudgeRule, const char*> list[] = {
      {JudgeRule::chi_square, "chi_square"}, {JudgeRule::paper, "paper"}};
};

namespace {

using namespace nb::literals;

void bind_results(nb::module_& m) {
  nb::enum_<Belief>(m, "Belief", "What the judge makes of one stereo pair at an instant.")
      .value("joined", Belief::joined, "Believed.")
      .value("disagrees", Belief::disagrees,
             "Moves otherwise than the others; by the paper's rule: is not chosen.")
      .value("lost", Belief::lost, "Gives no pose; its reason says why.")
      .value("absent", Belief::absent, "Gives no pictures.");
  nb::class_<PairVerdict>(m, "PairVerdict", "What one stereo pair contributes at an instant.")
      .def_ro("belief", &PairVerdict::belief)
      .def_ro("status", &PairVerdict::status)
      .def_ro("reason", &PairVerdict::reason)
      .def_ro("m_q", &PairVerdict::m_q)
      .def_ro("difference", &PairVerdict::difference,
              "(6,): motion over the window against that of the others, in the robot's frame: "
              "metres, then radians.")
      .def_ro("chi_square", &PairVerdict::chi_square, "Of it; 6 degrees of freedom.");
  nb::class_<JointResult>(m, "JointResult", "The joint trajectory at an instant.")
      .def_ro("timestamp_ns", &JointResult::timestamp_ns)
      .def_ro("status", &JointResult::status)
      .def_ro("world_from_robot", &JointResult::world_from_robot, "None if lost.")
      .def_prop_ro(
          "covariance",
          [](const JointResult& self) -> std::optional<Matrix6d> {
            if (!self.world_from_robot) return std::nullopt;
            return self.covariance;
          },
          "(6, 6): x y z in metres along the world's axes, rotation in radians about them.")
      .def_ro("segment", &JointResult::segment)
      .def_ro("pairs", &JointResult::pairs);
}

}  // namespace

void bind_judge(nb::module_& m) {
  bind_config<JudgeConfig>(m, "JudgeConfig",
                           "Everything that can be set of the judge, with its defaults.");
  bind_results(m);
  nb::class_<Judge>(m, "Judge",
                    "Compares the trajectories of a robot's stereo pairs and joins them.")
      .def(nb::init<int, const JudgeConfig&>(), nb::kw_only(), "pairs"_a,
           "config"_a = JudgeConfig{})
      .def(
          "add", &Judge::add, "pair"_a, "result"_a,
          "Take what a pair's odometry said (OdometryResult of the robot); return the JointResults "
          "that it decides. ValueError when times do not rise.")
      .def("finish", &Judge::finish, "Return the JointResults that still wait for other pairs.")
      .def("again", &Judge::again,
           "Return a Judge of the adjusted results of the same drive, who knows whom this one set "
           "aside and when: an adjustment spreads a sudden fault until it looks like motion.")
      .def("set_aside", &Judge::set_aside,
           "Return a bool for each pair: contradicted by the others to the end. Join what such a "
           "pair said at the time, for its adjusted path is spoilt from its beginning.");
}

}  // namespace pilotage
