# The C++ library for others (docs/cpp.md):
#
#   cmake --install BUILD --component cpp --prefix PREFIX
#
# installs headers, the static library, and what find_package(octobrick_codec) reads.

include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

# One version, which pyproject.toml says.
file(STRINGS "${PROJECT_SOURCE_DIR}/pyproject.toml" version REGEX "^version = \"[0-9.]+\"$")
string(REGEX REPLACE "^version = \"(.*)\"$" "\\1" version "${version}")
if(NOT version)
  message(FATAL_ERROR "pyproject.toml has no line 'version = \"…\"'")
endif()

set(package octobrick_codec)
set(package_folder "${CMAKE_INSTALL_LIBDIR}/cmake/${package}")
set_target_properties(octobrick_codec PROPERTIES EXPORT_NAME codec)
install(TARGETS octobrick_codec EXPORT ${package}
  ARCHIVE DESTINATION "${CMAKE_INSTALL_LIBDIR}" COMPONENT cpp
  INCLUDES DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}")
install(DIRECTORY include/ DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}" COMPONENT cpp)
install(EXPORT ${package} FILE ${package}-targets.cmake NAMESPACE octobrick::
  DESTINATION "${package_folder}" COMPONENT cpp)

write_basic_package_version_file("${CMAKE_CURRENT_BINARY_DIR}/${package}-config-version.cmake"
  VERSION "${version}" COMPATIBILITY SameMinorVersion)
install(
  FILES cmake/${package}-config.cmake
    "${CMAKE_CURRENT_BINARY_DIR}/${package}-config-version.cmake"
  DESTINATION "${package_folder}" COMPONENT cpp)
