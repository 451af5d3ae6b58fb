// SPDX-License-Identifier: Apache-2.0
// What view_renderer.hpp includes and more than it uses: to be included before an instruction set
// is chosen, so that it is compiled for every processor.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "geometry/dispatch.hpp"
#include "rendering/placed_shape.hpp"
#include "rendering/view.hpp"
