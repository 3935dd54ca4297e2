# Builds the core for Windows, with Debian's g++-mingw-w64-x86-64-posix and libglm-dev:
#   cmake -S . -B build/windows -DCMAKE_TOOLCHAIN_FILE=cmake/mingw-w64.cmake && cmake --build build/windows
set(CMAKE_SYSTEM_NAME Windows)
set(CMAKE_SYSTEM_PROCESSOR x86_64)
set(CMAKE_CXX_COMPILER x86_64-w64-mingw32-g++-posix)

# GLM is headers alone, but they lie beside those of Linux, so it is copied to a folder of its own.
get_property(trying GLOBAL PROPERTY IN_TRY_COMPILE)
if(NOT trying AND EXISTS /usr/share/cmake/glm)
  file(COPY /usr/include/glm DESTINATION ${CMAKE_BINARY_DIR}/glm/include)
  file(COPY /usr/share/cmake/glm DESTINATION ${CMAKE_BINARY_DIR}/glm/share/cmake)
  set(glm_DIR ${CMAKE_BINARY_DIR}/glm/share/cmake/glm)
endif()
