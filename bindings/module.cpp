// SPDX-License-Identifier: Apache-2.0
#include <nanobind/nanobind.h>

namespace pilotage {

// One file for each folder of cpp/; each adds its classes and functions to the module.
void bind_geometry(nanobind::module_& m);
void bind_tracking(nanobind::module_& m);
void bind_correlation(nanobind::module_& m);
void bind_estimation(nanobind::module_& m);
void bind_two_views(nanobind::module_& m);
void bind_homography(nanobind::module_& m);
void bind_bundle_adjustment(nanobind::module_& m);
void bind_odometry(nanobind::module_& m);
void bind_judge(nanobind::module_& m);
void bind_reconstruction(nanobind::module_& m);
void bind_walk(nanobind::module_& m);
void bind_rendering(nanobind::module_& m);

}  // namespace pilotage

NB_MODULE(_core, m) {
  m.doc() = "The compiled part of pilotage; import its names from `pilotage`.";
  pilotage::bind_geometry(m);
  pilotage::bind_tracking(m);
  pilotage::bind_correlation(m);
  pilotage::bind_estimation(m);
  pilotage::bind_two_views(m);
  pilotage::bind_homography(m);
  pilotage::bind_bundle_adjustment(m);
  pilotage::bind_odometry(m);
  pilotage::bind_judge(m);
  pilotage::bind_reconstruction(m);
  pilotage::bind_walk(m);
  pilotage::bind_rendering(m);
}
