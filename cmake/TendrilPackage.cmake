# Installation, and the Debian package (cpack -G DEB in the build folder).
set(systemd ${PROJECT_SOURCE_DIR}/config/systemd)
install(DIRECTORY config/ DESTINATION ${CMAKE_INSTALL_DATADIR}/tendril/config PATTERN systemd EXCLUDE)
install(DIRECTORY lcm_types/ DESTINATION ${CMAKE_INSTALL_DATADIR}/tendril/lcm_types FILES_MATCHING PATTERN "*.lcm")
file(GLOB plot_scripts CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tools/*.py)
install(PROGRAMS ${plot_scripts} DESTINATION ${CMAKE_INSTALL_DATADIR}/tendril)
install(DIRECTORY examples DESTINATION ${CMAKE_INSTALL_DOCDIR} USE_SOURCE_PERMISSIONS)
install(FILES README.md CHANGELOG.md ${systemd}/copyright DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY docs/pictures DESTINATION ${CMAKE_INSTALL_DOCDIR}/docs)
install(FILES ${systemd}/tendril-gap-watch@.service ${systemd}/tendril-gap-watch@.timer DESTINATION lib/systemd/system)
install(FILES ${systemd}/tendril.tmpfiles DESTINATION lib/tmpfiles.d RENAME tendril.conf)

# For other projects: find_package(tendril COMPONENTS io ...), see examples/.
include(CMakePackageConfigHelpers)
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/tendril)
install(TARGETS tendril_options EXPORT tendril)
install(EXPORT tendril NAMESPACE tendril:: FILE tendrilTargets.cmake DESTINATION ${package_dir})
configure_package_config_file(cmake/tendrilConfig.cmake.in ${PROJECT_BINARY_DIR}/package/tendrilConfig.cmake
  INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/package/tendrilConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/package/tendrilConfig.cmake ${PROJECT_BINARY_DIR}/package/tendrilConfigVersion.cmake
  cmake/FindLCM.cmake DESTINATION ${package_dir})

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "Tendril maintainers <maintainers@tendril.invalid>")

# The package's own changelog, in Debian's format; reproducible with SOURCE_DATE_EPOCH.
find_program(GZIP gzip)
if(GZIP)
  string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
  file(WRITE ${PROJECT_BINARY_DIR}/package/changelog "tendril (${PROJECT_VERSION}) stable; urgency=medium

  * What changed is in CHANGELOG.md, beside this file.

 -- ${CPACK_PACKAGE_CONTACT}  ${date}
")
  execute_process(COMMAND ${GZIP} -9nf ${PROJECT_BINARY_DIR}/package/changelog)
  install(FILES ${PROJECT_BINARY_DIR}/package/changelog.gz DESTINATION ${CMAKE_INSTALL_DOCDIR})
endif()
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
# Permissions of folders and scripts as Debian requires, independent of the builder's umask.
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY ${PROJECT_DESCRIPTION})
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION "\
Commanded over LCM, tendrild holds, bends and moves a continuum robot whose
tendons are pulled by CANopen drives in torque mode. With it come the tools to
operate it, a simulated rig that answers on a virtual CAN bus, and a diagnosis
of the gap between the two.
.
The service starts when there is an /etc/tendril/tendrild.yaml and somebody
enables it; a robot moves when somebody arms it.")
# Needs file(1) and dpkg-shlibdeps; without them the package would have no dependencies.
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA "${systemd}/postinst;${systemd}/prerm;${systemd}/postrm")
# The unit waits for the loop-back interface's multicast route with ip(8).
set(CPACK_DEBIAN_PACKAGE_DEPENDS "iproute2")
# A robot computer needs no plots.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "systemd, udev, python3, python3-matplotlib, python3-numpy")
include(CPack)
