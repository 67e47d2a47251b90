# PETSc with real scalars, and the MPI that it was built with, for the methods
# tao_*. Debian keeps its headers in a folder of the version, which only
# pkg-config knows.
find_package(PkgConfig QUIET)
if(PkgConfig_FOUND)
  pkg_check_modules(PC_PETSC QUIET petsc>=3.17)
endif()
if(PC_PETSC_FOUND)
  find_package(MPI QUIET COMPONENTS C)
  find_path(PETSC_INCLUDE_DIR petsctao.h HINTS ${PC_PETSC_INCLUDE_DIRS})
  find_library(PETSC_LIBRARY NAMES petsc_real petsc HINTS ${PC_PETSC_LIBRARY_DIRS})
  mark_as_advanced(PETSC_INCLUDE_DIR PETSC_LIBRARY)
  if(MPI_C_FOUND AND PETSC_INCLUDE_DIR AND PETSC_LIBRARY)
    file(STRINGS ${PETSC_INCLUDE_DIR}/petscconf.h complex
         REGEX "^#define PETSC_USE_(COMPLEX|REAL_SINGLE|REAL___FLOAT128|REAL___FP16) ")
    if(NOT complex)
      set(optional_found TRUE)
      set(optional_include_dirs ${PETSC_INCLUDE_DIR} ${MPI_C_INCLUDE_DIRS})
      set(optional_libraries ${PETSC_LIBRARY} ${MPI_C_LIBRARIES})
      set(optional_pkg_config ${optional_libraries})
    endif()
  endif()
endif()
