// SPDX-License-Identifier: Apache-2.0
#pragma once

// Kernels are written as plain loops or with the compiler's vector extensions and compiled for
// several instruction sets; the loader picks at run time. Elsewhere than x86-64 the one build uses
// the platform's own vectors (NEON on aarch64).
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__)
#define PILOTAGE_HAS_CLONES 1
#define PILOTAGE_KERNEL \
  __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
// For kernels that shuffle bytes, which the second level brought: of small robots' processors many
// have it and not the third.
#define PILOTAGE_SHUFFLE_KERNEL \
  __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "arch=x86-64-v2", "default")))
#else
#define PILOTAGE_HAS_CLONES 0
#define PILOTAGE_KERNEL
#define PILOTAGE_SHUFFLE_KERNEL
#endif
#define PILOTAGE_INLINE inline __attribute__((always_inline))
