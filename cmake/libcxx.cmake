# Builds the core with Clang and libc++, the compiler and the standard library of macOS and Android. With Debian's clang-16,
# libc++-16-dev, libc++abi-16-dev, and doctest-dev for the tests:
#   cmake -S . -B build/libcxx -DCMAKE_TOOLCHAIN_FILE=cmake/libcxx.cmake -DFASTIBL_TESTS=ON
#   cmake --build build/libcxx && ctest --test-dir build/libcxx
set(CMAKE_CXX_COMPILER clang++-16)
set(CMAKE_CXX_FLAGS_INIT -stdlib=libc++)
