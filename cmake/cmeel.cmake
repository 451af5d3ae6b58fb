# SPDX-License-Identifier: Apache-2.0
# The cmeel-* packages put C++ headers and CMake files under <site-packages>/cmeel.prefix. Where that
# is differs between a plain environment and an isolated build, so the building Python is asked.
execute_process(
  COMMAND
    ${Python_EXECUTABLE} -c
    "import pathlib, sys; print(';'.join(p for s in sys.path if (p := str(pathlib.Path(s, 'cmeel.prefix'))) and pathlib.Path(p).is_dir()))"
  OUTPUT_VARIABLE cmeel_prefixes
  OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
list(PREPEND CMAKE_PREFIX_PATH ${cmeel_prefixes})
