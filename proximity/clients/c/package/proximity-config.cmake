# find_package(proximity CONFIG) gives the target proximity::proximity, and proximity::static where there is one.
get_filename_component(_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET proximity::proximity)
  add_library(proximity::proximity SHARED IMPORTED)
  set_target_properties(proximity::proximity PROPERTIES
    IMPORTED_LOCATION "${_prefix}/lib/@LIBRARY@"
    INTERFACE_INCLUDE_DIRECTORIES "${_prefix}/include")
  if(WIN32)
    set_target_properties(proximity::proximity PROPERTIES IMPORTED_IMPLIB "${_prefix}/lib/proximity.lib")
  endif()
endif()
if(EXISTS "${_prefix}/lib/libproximity.a" AND NOT TARGET proximity::static)
  add_library(proximity::static STATIC IMPORTED)
  set_target_properties(proximity::static PROPERTIES
    IMPORTED_LOCATION "${_prefix}/lib/libproximity.a"
    IMPORTED_LINK_INTERFACE_LANGUAGES C
    INTERFACE_LINK_LIBRARIES m
    INTERFACE_INCLUDE_DIRECTORIES "${_prefix}/include")
endif()
unset(_prefix)
