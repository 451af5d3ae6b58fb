// SPDX-License-Identifier: Apache-2.0
#include <nanobind/nanobind.h>

namespace pilotage {

// One file for each folder of cpp/; each adds its classes and functions to the module.
void bind_geometry(nanobind::module_& m);
void bind_tracking(nanobind::module_& m);
void bind_estimation(nanobind::module_& m);
void bind_bundle_adjustment(nanobind::module_& m);
void bind_odometry(nanobind::module_& m);

}  // namespace pilotage

NB_MODULE(_core, m) {
  m.doc() = "The compiled part of pilotage; import its names from `pilotage`.";
  pilotage::bind_geometry(m);
#ifdef PILOTAGE_HAS_TRACKING
  pilotage::bind_tracking(m);
#endif
#ifdef PILOTAGE_HAS_ESTIMATION
  pilotage::bind_estimation(m);
#endif
#ifdef PILOTAGE_HAS_BUNDLE_ADJUSTMENT
  pilotage::bind_bundle_adjustment(m);
#endif
#ifdef PILOTAGE_HAS_ODOMETRY
  pilotage::bind_odometry(m);
#endif
}
