// Runs a target without libFuzzer. Arguments: files and folders of seeds, and numbers. A number
// runs that many random inputs, the same ones every time. The random input at which it stops or
// hangs is left in ./random-input.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

#include "input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace {

long runs = 0;

void run(const std::vector<char>& bytes) {
  LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  ++runs;
}

void run_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::fprintf(stderr, "%s\n", path.c_str());  // so that one sees which file crashes
  run({std::istreambuf_iterator<char>(file), {}});
}

void run_random(long count) {
  const char* kept = "random-input";
  std::mt19937_64 random(1);
  for (long i = 0; i < count; ++i) {
    std::vector<char> bytes(random() % 2048);
    for (char& b : bytes) b = char(random());
    std::ofstream(kept, std::ios::binary).write(bytes.data(), std::streamsize(bytes.size()));
    run(bytes);
  }
  std::filesystem::remove(kept);
}

}  // namespace

int main(int count, char** arguments) {
  for (int i = 1; i < count; ++i) {
    char* end = nullptr;
    const long random = std::strtol(arguments[i], &end, 10);
    if (*end == 0) {
      run_random(random);
    } else if (std::filesystem::is_directory(arguments[i])) {
      for (const auto& entry : std::filesystem::directory_iterator(arguments[i]))
        run_file(entry.path());
    } else if (std::filesystem::exists(arguments[i])) {
      run_file(arguments[i]);
    } else {
      std::fprintf(stderr, "no seeds at %s\n", arguments[i]);
      return 2;
    }
  }
  std::printf("%ld inputs\n", runs);
}
