# Read by find_package(octobrick_codec): defines the target octobrick::codec.

include(CMakeFindDependencyMacro)
find_dependency(Threads)
include("${CMAKE_CURRENT_LIST_DIR}/octobrick_codec-targets.cmake")
