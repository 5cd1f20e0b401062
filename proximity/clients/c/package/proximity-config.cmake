# find_package(proximity CONFIG) gives the target proximity::proximity.
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
unset(_prefix)
