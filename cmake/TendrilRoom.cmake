# tendril_room(NAME SOURCES ... [ROOMS ...] [LINK ...] [LINK_PRIVATE ...] [INTERNAL])
# A room: a static library with its interface in include/tendril/NAME. ROOMS are the rooms whose headers
# it may include; tests/architecture checks the includes against this same list. It is installed for other projects
# (find_package(tendril)) unless it is INTERNAL to the programs.
function(tendril_room name)
  cmake_parse_arguments(ARG "INTERNAL" "" "SOURCES;ROOMS;LINK;LINK_PRIVATE" ${ARGN})
  if(ARG_SOURCES)
    add_library(tendril_${name} STATIC ${ARG_SOURCES})
    set(scope PUBLIC)
    set(private PRIVATE)
  else()
    add_library(tendril_${name} INTERFACE)
    set(scope INTERFACE)
    set(private INTERFACE)
  endif()
  add_library(tendril::${name} ALIAS tendril_${name})
  list(TRANSFORM ARG_ROOMS PREPEND tendril:: OUTPUT_VARIABLE rooms)
  target_link_libraries(tendril_${name} ${scope} tendril_options ${rooms} ${ARG_LINK})
  if(ARG_LINK_PRIVATE)
    target_link_libraries(tendril_${name} ${private} ${ARG_LINK_PRIVATE})
  endif()
  if(ARG_SOURCES)
    # Compiled by eights: what they include is read once. g++ takes types of an included .cpp for those of a header.
    set_target_properties(tendril_${name} PROPERTIES UNITY_BUILD ${TENDRIL_UNITY} UNITY_BUILD_BATCH_SIZE 8)
    target_compile_options(tendril_${name} PRIVATE -Wno-subobject-linkage)
  endif()
  set_property(GLOBAL APPEND PROPERTY TENDRIL_ROOM_RULES "${name}:${ARG_ROOMS}")
  if(NOT ARG_INTERNAL)
    set_target_properties(tendril_${name} PROPERTIES EXPORT_NAME ${name})
    install(TARGETS tendril_${name} EXPORT tendril ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
    install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/tendril/${name} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/tendril)
  endif()
endfunction()

# tendril_compile_together(TARGET GROUP ...): compiles each list of the target's files as one, in less than half of the
# time: what they include is read once. In a group, names without linkage are told apart.
function(tendril_compile_together target)
  set_target_properties(${target} PROPERTIES UNITY_BUILD ${TENDRIL_UNITY} UNITY_BUILD_MODE GROUP)
  foreach(group ${ARGN})
    set_source_files_properties(${${group}} PROPERTIES UNITY_GROUP ${group})
  endforeach()
endfunction()

# tendril_test(NAME SOURCES ... LINK ... [LABELS ...] [TIMEOUT s] [COST s] [SERIAL filter] [WHOLE suites] [OWN_NETWORK]): a
# GoogleTest program whose cases ctest lists. COST is what its longest case takes: ctest starts those of a high cost first, so
# that none is left alone at the end. Cases of the filter SERIAL check timing and run alone; a suite in WHOLE is one test: it
# shares its set-up, or with OWN_NETWORK a network without other programs. With the label vcan the program runs as a
# whole where a real vcan0 exists, because that may need the start of another kernel. Cases of instantiations named
# Campaign take too long for every build; run them with --gtest_filter='Campaign/*'.
function(tendril_test name)
  cmake_parse_arguments(ARG "OWN_NETWORK" "TIMEOUT;COST;SERIAL" "SOURCES;LINK;LABELS;WHOLE" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  if(NOT ARG_COST)
    set(ARG_COST 0)
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE tendril_options ${ARG_LINK} GTest::gtest_main GTest::gmock)
  target_compile_definitions(${name} PRIVATE TENDRIL_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  # The tested code is optimised as shipped; the tests only by -O1. g++ 12 reports a false out-of-bounds write of
  # std::string's operator+ with precompiled headers.
  set(options $<$<CONFIG:Release>:-O1> -Wno-array-bounds -Wno-stringop-overflow -Wno-restrict)
  target_compile_options(${name} PRIVATE ${options})
  # The tests share large headers, which take nearly half of their compile time.
  if(NOT TARGET tendril_test_headers)
    file(CONFIGURE OUTPUT ${PROJECT_BINARY_DIR}/test_headers.cpp CONTENT "int main() {}\n")
    add_executable(tendril_test_headers ${PROJECT_BINARY_DIR}/test_headers.cpp)
    target_link_libraries(tendril_test_headers PRIVATE tendril_options Eigen3::Eigen GTest::gtest_main GTest::gmock)
    target_compile_options(tendril_test_headers PRIVATE ${options})
    target_precompile_headers(tendril_test_headers PRIVATE <gmock/gmock.h> <gtest/gtest.h> <Eigen/Dense>)
  endif()
  target_precompile_headers(${name} REUSE_FROM tendril_test_headers)
  set_target_properties(${name} PROPERTIES UNITY_BUILD ${TENDRIL_UNITY} UNITY_BUILD_BATCH_SIZE 6)
  if(vcan IN_LIST ARG_LABELS)
    tendril_vcan_test(${name} TIMEOUT ${ARG_TIMEOUT} COMMAND $<TARGET_FILE:${name}>)
    return()
  endif()
  set(elsewhere Campaign/*)
  set(network)
  if(ARG_OWN_NETWORK)
    if(NOT ARG_WHOLE)
      message(FATAL_ERROR "${name}: OWN_NETWORK is for the suites in WHOLE; name them")
    endif()
    set(network ${PROJECT_SOURCE_DIR}/tests/tools/own_network.sh)
  endif()
  if(ARG_SERIAL)
    gtest_discover_tests(${name} DISCOVERY_MODE PRE_TEST NO_PRETTY_VALUES TEST_FILTER ${ARG_SERIAL} TEST_LIST ${name}_serial
      PROPERTIES TIMEOUT ${ARG_TIMEOUT} COST ${ARG_COST} LABELS "${ARG_LABELS}" RUN_SERIAL TRUE)
    list(APPEND elsewhere ${ARG_SERIAL})
  endif()
  foreach(suite ${ARG_WHOLE})
    add_test(NAME ${suite} COMMAND ${network} $<TARGET_FILE:${name}> --gtest_filter=${suite}.*)
    set_tests_properties(${suite} PROPERTIES TIMEOUT ${ARG_TIMEOUT} COST ${ARG_COST} LABELS "${ARG_LABELS}" SKIP_RETURN_CODE 77
      FAIL_REGULAR_EXPRESSION "Running 0 tests")  # a filter without a suite would pass
    list(APPEND elsewhere ${suite}.*)
  endforeach()
  list(JOIN elsewhere : elsewhere)
  gtest_discover_tests(${name} DISCOVERY_MODE PRE_TEST NO_PRETTY_VALUES TEST_FILTER *-${elsewhere}
    PROPERTIES TIMEOUT ${ARG_TIMEOUT} COST ${ARG_COST} LABELS "${ARG_LABELS}")
endfunction()

# tendril_vcan_test(NAME COMMAND ... [TIMEOUT s]): a test that runs where a real vcan0 exists; else skipped with the
# reason. TIMEOUT counts the test's own (virtual) time.
function(tendril_vcan_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "COMMAND" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  set(kernel uml)
  if(TENDRIL_SANITIZE)
    set(kernel host)
  endif()
  add_test(NAME ${name} COMMAND ${PROJECT_SOURCE_DIR}/tests/tools/in_vcan.sh
    ${kernel} $<TARGET_FILE:tendril_virtual_time> ${ARG_TIMEOUT} ${ARG_COMMAND})
  set_tests_properties(${name} PROPERTIES LABELS vcan TIMEOUT 900 SKIP_RETURN_CODE 77)
  execute_process(COMMAND ${PROJECT_SOURCE_DIR}/tools/vcan-run --kernel uml --check
    RESULT_VARIABLE no_uml OUTPUT_QUIET ERROR_QUIET)
  if(kernel STREQUAL uml AND no_uml EQUAL 0)
    # In virtual time, tests on other cores have no effect; the longest start first.
    set_tests_properties(${name} PROPERTIES RESOURCE_LOCK vcan COST 1000)
  else()
    set_tests_properties(${name} PROPERTIES RUN_SERIAL TRUE)
  endif()
endfunction()
