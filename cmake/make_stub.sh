#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Writes the type stub of the C++ extension. Usage: make_stub.sh BIN_OF_THE_ENVIRONMENT OUTPUT
set -eu
bin=$1
output=$2
mkdir -p "$(dirname "$output")"
"$bin/python" -m nanobind.stubgen --quiet --module pilotage._core --output-file "$output.raw"
{
  echo '# SPDX-License-Identifier: Apache-2.0'
  cat "$output.raw"
} > "$output"
rm "$output.raw"
"$bin/ruff" format --quiet "$output"
