# hypre, for linear=amg: libhypre-dev, built with MPI.
find_path(HYPRE_INCLUDE_DIR HYPRE_parcsr_ls.h PATH_SUFFIXES hypre)
find_library(HYPRE_LIBRARY HYPRE)
# Of Debian's two the one that its hypre is built with, whichever is the default.
find_path(HYPRE_MPI_INCLUDE_DIR mpi.h
  PATHS /usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/openmpi/include)
find_library(HYPRE_MPI_LIBRARY mpi
  HINTS /usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/openmpi/lib)
mark_as_advanced(HYPRE_INCLUDE_DIR HYPRE_LIBRARY
                 HYPRE_MPI_INCLUDE_DIR HYPRE_MPI_LIBRARY)
if(HYPRE_INCLUDE_DIR AND HYPRE_LIBRARY AND HYPRE_MPI_INCLUDE_DIR
   AND HYPRE_MPI_LIBRARY)
  set(optional_found TRUE)
  set(optional_include_dirs ${HYPRE_INCLUDE_DIR} ${HYPRE_MPI_INCLUDE_DIR})
  set(optional_libraries ${HYPRE_LIBRARY} ${HYPRE_MPI_LIBRARY})
  set(optional_pkg_config -lHYPRE -lmpi)
endif()
