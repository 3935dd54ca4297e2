# For toolchain files: GLM is headers alone, but they lie beside those of the system, so it is copied to a folder of its own.
get_property(trying GLOBAL PROPERTY IN_TRY_COMPILE)
if(NOT trying AND EXISTS /usr/share/cmake/glm)
  file(COPY /usr/include/glm DESTINATION ${CMAKE_BINARY_DIR}/glm/include)
  file(COPY /usr/share/cmake/glm DESTINATION ${CMAKE_BINARY_DIR}/glm/share/cmake)
  set(glm_DIR ${CMAKE_BINARY_DIR}/glm/share/cmake/glm)
endif()
