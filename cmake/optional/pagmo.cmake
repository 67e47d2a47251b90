# pagmo, for the searches cma_es and differential_evolution.
find_path(PAGMO_INCLUDE_DIR pagmo/algorithms/cmaes.hpp)
find_library(PAGMO_LIBRARY pagmo)
# Its headers include both.
find_path(PAGMO_SERIALIZATION_INCLUDE_DIR boost/serialization/access.hpp)
find_library(PAGMO_SERIALIZATION_LIBRARY boost_serialization)
mark_as_advanced(PAGMO_INCLUDE_DIR PAGMO_LIBRARY
                 PAGMO_SERIALIZATION_INCLUDE_DIR PAGMO_SERIALIZATION_LIBRARY)
if(PAGMO_INCLUDE_DIR AND PAGMO_LIBRARY AND PAGMO_SERIALIZATION_INCLUDE_DIR
   AND PAGMO_SERIALIZATION_LIBRARY)
  set(optional_found TRUE)
  set(optional_include_dirs ${PAGMO_INCLUDE_DIR})
  set(optional_libraries ${PAGMO_LIBRARY} ${PAGMO_SERIALIZATION_LIBRARY})
  set(optional_pkg_config -lpagmo -lboost_serialization)
endif()
