# `cmake --install`: the libraries with their headers, as the CMake package granopt
# (targets granopt::solvers, granopt::searches and granopt::granular) and as the
# pkg-config packages granopt-solvers, granopt-searches and granopt-granular. What is
# installed can be moved.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

install(TARGETS solvers searches granular EXPORT granoptTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
  RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
# Headers are included as in this tree: #include "solvers/solver.h".
install(DIRECTORY solvers granular
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/granopt
  FILES_MATCHING PATTERN "*.h"
  PATTERN methods EXCLUDE)
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})

# ---- find_package(granopt) ------------------------------------------------------
set(granopt_cmake_dir ${CMAKE_INSTALL_LIBDIR}/cmake/granopt)
install(EXPORT granoptTargets NAMESPACE granopt:: DESTINATION ${granopt_cmake_dir})
configure_package_config_file(
  cmake/granoptConfig.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/granoptConfig.cmake
  INSTALL_DESTINATION ${granopt_cmake_dir})
write_basic_package_version_file(
  ${CMAKE_CURRENT_BINARY_DIR}/granoptConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/granoptConfig.cmake
              ${CMAKE_CURRENT_BINARY_DIR}/granoptConfigVersion.cmake
        DESTINATION ${granopt_cmake_dir})

# ---- pkg-config -----------------------------------------------------------------
# granopt_pkg_config(NAME DESCRIPTION REQUIRES LIBS HIDDEN PUBLIC CERES): PUBLIC are
# the libraries that headers refer to, HIDDEN those that only LIBS do. A shared
# library names the latter itself; with a static one every link needs them, not just
# one with `pkg-config --static`. CERES are those of a Ceres that is static, too: it
# has no .pc file to say so.
set(granopt_pc_dir ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
file(RELATIVE_PATH pc_to_prefix
     ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig ${CMAKE_INSTALL_PREFIX})
string(REGEX REPLACE "/$" "" pc_to_prefix "${pc_to_prefix}")
get_target_property(granopt_library_type solvers TYPE)
function(granopt_pkg_config pc_name pc_description pc_requires libs hidden public ceres)
  if(granopt_library_type STREQUAL "SHARED_LIBRARY")
    set(pc_libs ${libs} ${public})
    set(pc_libs_private ${hidden} ${ceres})
  else()
    set(pc_libs ${libs} ${hidden} ${public})
    set(pc_libs_private ${ceres})
  endif()
  list(JOIN pc_libs " " pc_libs)
  list(JOIN pc_libs_private " " pc_libs_private)
  configure_file(cmake/granopt.pc.in ${CMAKE_CURRENT_BINARY_DIR}/${pc_name}.pc @ONLY)
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/${pc_name}.pc
          DESTINATION ${granopt_pc_dir})
endfunction()
set(hidden ${solvers_optional_pkg_config} -lglog)
list(PREPEND hidden -lamd)
if(OpenMP_CXX_FOUND)
  list(TRANSFORM OpenMP_CXX_LIB_NAMES PREPEND -l OUTPUT_VARIABLE openmp)
  list(PREPEND hidden ${openmp})
elseif(GOMP_LIBRARY)
  list(PREPEND hidden -lgomp)
endif()
if(GRANOPT_CHOLMOD)
  list(PREPEND hidden -lcholmod)
endif()
granopt_pkg_config(granopt-solvers
  "Optimization methods behind one interface, built on Ceres"
  "eigen3 >= 3.4" "-lgranopt_solvers" "${hidden}" "-lceres"
  "-lglog;-lgflags;-lspqr;-lcholmod;-lcxsparse;-llapack;-lblas;-lpthread")
granopt_pkg_config(granopt-searches
  "Least values of objectives without derivatives, by name"
  "granopt-solvers = ${PROJECT_VERSION}" "-lgranopt_searches"
  "${searches_optional_pkg_config};-lglog" "-lceres" "")
granopt_pkg_config(granopt-granular
  "${PROJECT_DESCRIPTION}"
  "granopt-solvers = ${PROJECT_VERSION}" "-lgranopt_granular" "-lquadmath" "" "")
