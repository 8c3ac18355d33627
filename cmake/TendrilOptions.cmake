# Language level, warnings, sanitizers: one place, the same for every room.
option(TENDRIL_TESTS "Build the tests" ON)
option(TENDRIL_BENCH "Build the benchmarks" ON)
option(TENDRIL_WERROR "Treat warnings as errors" ON)
option(TENDRIL_NATIVE "Use every instruction of this machine (binaries are not portable)" OFF)
option(TENDRIL_UNITY "Compile a room's files together: faster as a whole, slower after a small change" ON)
# tools/setup makes an environment with the packages of tests/requirements.txt and others; tests that miss one skip, and
# without nanobind the Python package is not built.
set(TENDRIL_TEST_PYTHON /usr/bin/python3 CACHE FILEPATH "Python for tests with PyPI packages")
set(TENDRIL_SANITIZE "" CACHE STRING "Sanitizers: address, undefined, thread (comma separated)")

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
endif()

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)

# The installed targets require only the language level and the include folder of other projects.
add_library(tendril_options INTERFACE)
target_compile_features(tendril_options INTERFACE cxx_std_20)
set(own_options
  -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual -Wold-style-cast
  -Wcast-align -Wdouble-promotion -Wformat=2 -Wimplicit-fallthrough
  $<$<BOOL:${TENDRIL_WERROR}>:-Werror>
  $<$<BOOL:${TENDRIL_NATIVE}>:-march=native>)
target_compile_options(tendril_options INTERFACE "$<BUILD_INTERFACE:${own_options}>")
# The same input gives the same bits on every call: no contraction, no re-association.
target_compile_options(tendril_options INTERFACE $<BUILD_INTERFACE:-ffp-contract=off>)
target_include_directories(tendril_options INTERFACE
  $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)

if(TENDRIL_SANITIZE)
  target_compile_options(tendril_options INTERFACE
    -fsanitize=${TENDRIL_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  target_link_options(tendril_options INTERFACE -fsanitize=${TENDRIL_SANITIZE})
endif()
