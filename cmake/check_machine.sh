#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Says what this machine lacks to build Pilotage, and the remedy. Usage: check_machine.sh PYTHON
set -u
python=$1

refuse() {
  printf 'pilotage: %s\n  remedy: %s\n' "$1" "$2" >&2
  exit 1
}

command -v "$python" >/dev/null 2>&1 ||
  refuse "no '$python' found" "install Python 3.11 or newer, or name one: make setup PYTHON=python3.12"
version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])') ||
  refuse "'$python' does not run" "name another: make setup PYTHON=python3.12"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
  refuse "'$python' is Python $version, and 3.11 is the oldest that works" \
    "install a newer one and name it: make setup PYTHON=python3.12"
"$python" -c 'import ensurepip, venv' 2>/dev/null ||
  refuse "'$python' cannot make a virtual environment (module venv or ensurepip is missing)" \
    "install it (Debian, Ubuntu: python$version-venv)"
"$python" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' ||
  refuse "'$python' has no headers (Python.h)" "install them (Debian, Ubuntu: python$version-dev)"

compiler=${CXX:-}
for name in c++ g++ clang++; do
  [ -n "$compiler" ] && break
  command -v "$name" >/dev/null 2>&1 && compiler=$name
done
[ -n "$compiler" ] ||
  refuse "no C++ compiler found" "install g++ 11 or newer, or clang++ 14 or newer; or set CXX"
# CXX may hold options too, so it is split into words.
printf '#include <concepts>\ntemplate <std::integral T> T f(T x) { return x; }\nint main() { return f(0); }\n' |
  $compiler -std=c++20 -x c++ -fsyntax-only - 2>/dev/null ||
  refuse "'$compiler' does not compile C++20" \
    "install g++ 11 or newer, or clang++ 14 or newer; or set CXX to one"
