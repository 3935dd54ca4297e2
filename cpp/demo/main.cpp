#include <iostream>
#include <opencv2/core/utility.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <stdexcept>

#include "demo/headless.h"
#ifdef FASTIBL_WITH_WINDOW
#include "demo/show.h"
#endif
#include "fastibl/core/parallel.h"

namespace {

constexpr int kFailed = 1, kBadInput = 2;

bool run(const fastibl::demo::Args& args) {
  using namespace fastibl::demo;
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);  // we report errors
  cv::setNumThreads(1);  // the passes share the cores themselves
  fastibl::set_threads(args.threads);
  if (args.headless) return run_headless(args);
#ifdef FASTIBL_WITH_WINDOW
  show(args);
  return true;
#else
  throw std::invalid_argument(
      "this fastibl-demo was built without a window (GLFW 3.3, libepoxy); use --headless");
#endif
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const auto args = fastibl::demo::parse_args(argc, argv);
    return !args || run(*args) ? 0 : kFailed;
  } catch (const std::invalid_argument& error) {
    std::cerr << "fastibl-demo: " << error.what() << "\nRun fastibl-demo --help for all options.\n";
    return kBadInput;
  } catch (const std::exception& error) {
    std::cerr << "fastibl-demo: " << error.what() << '\n';
    return kFailed;
  }
}
