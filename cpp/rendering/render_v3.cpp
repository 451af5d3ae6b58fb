// SPDX-License-Identifier: Apache-2.0
#include "rendering/every_processor.hpp"

#if PILOTAGE_HAS_CLONES
#pragma GCC push_options
#pragma GCC target("arch=x86-64-v3")
#define PILOTAGE_ARCH arch_x86_64_v3
#include "rendering/view_renderer.hpp"
#pragma GCC pop_options
#endif
