# The version and the git revision, written into one source file of the core room at each build (recompiled only when
# they changed). A source tree without git has the revision "unknown".
set(TENDRIL_VERSION_SOURCE ${CMAKE_BINARY_DIR}/generated/version.cpp)
if(CMAKE_SCRIPT_MODE_FILE)
  set(revision unknown)
  find_program(GIT git)
  if(GIT AND EXISTS ${SOURCE_DIR}/.git)
    # The tree's owner may differ from the builder (root in a container): trust only this tree.
    execute_process(COMMAND ${GIT} -c safe.directory=${SOURCE_DIR} -C ${SOURCE_DIR} describe --always --dirty --abbrev=12
      OUTPUT_VARIABLE described OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE status)
    if(status EQUAL 0)
      set(revision ${described})
    endif()
  endif()
  file(CONFIGURE OUTPUT ${OUTPUT} CONTENT [[
// Written by cmake/TendrilVersion.cmake at each build.
#include "tendril/core/version.h"

namespace tendril {

std::string_view Version() { return "@VERSION@"; }
std::string_view GitRevision() { return "@revision@"; }

}  // namespace tendril
]] @ONLY)
  return()
endif()

add_custom_target(tendril_revision BYPRODUCTS ${TENDRIL_VERSION_SOURCE}
  COMMAND ${CMAKE_COMMAND} -DSOURCE_DIR=${PROJECT_SOURCE_DIR} -DVERSION=${PROJECT_VERSION}
          -DOUTPUT=${TENDRIL_VERSION_SOURCE} -P ${CMAKE_CURRENT_LIST_FILE}
  COMMENT "Git revision" VERBATIM)
