# Debian's liblcm-dev has no CMake package, and its pkg-config file needs GLib's development files,
# which the public LCM headers do not include: find the pieces directly.
find_path(LCM_INCLUDE_DIR lcm/lcm-cpp.hpp)
find_library(LCM_LIBRARY lcm)
find_program(LCM_GEN lcm-gen)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(LCM REQUIRED_VARS LCM_LIBRARY LCM_INCLUDE_DIR LCM_GEN)
if(LCM_FOUND AND NOT TARGET LCM::LCM)
  add_library(LCM::LCM UNKNOWN IMPORTED)
  set_target_properties(LCM::LCM PROPERTIES IMPORTED_LOCATION ${LCM_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${LCM_INCLUDE_DIR})
endif()
