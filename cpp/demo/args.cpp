#include "demo/args.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <vector>

#include "fastibl/core/check.h"

namespace fastibl::demo {
namespace {

// CLI11's own checks print the range of double.
const CLI::Validator kPositive(
    [](const std::string& text) {
      double value = 0;
      const bool good = CLI::detail::lexical_cast(text, value) && value > 0 && std::isfinite(value);
      return good ? std::string() : "expected a number above 0, got \"" + text + '"';
    },
    "");
const CLI::Validator kNotNegative(
    [](const std::string& text) {
      double value = 0;
      const bool good = CLI::detail::lexical_cast(text, value) && value >= 0;
      return good ? std::string() : "expected 0 or more, got \"" + text + '"';
    },
    "");

glm::vec3 colour(const std::vector<float>& values) { return {values[0], values[1], values[2]}; }

void check_together(const Args& args) {
  check(args.recording.empty() != (args.back < 0),
        "expected either --recording DIR or --back N, got ",
        args.recording.empty() ? "neither" : "both");
  if (args.back >= 0) {
    check(!args.rig.empty(), "live cameras need their calibration: expected --rig rig.yaml");
    check(!args.true_poses, "--poses truth needs a recording, got --back ", args.back);
  }
  check(args.front < 0 || args.back >= 0, "--front ", args.front, " needs --back N");
  check(args.headless || args.out.empty(), "--out is for --headless; use --screenshot in a window");
  check(!args.headless || args.screenshot.empty(),
        "--screenshot is of the window; use --out with --headless");
  check(args.back < 0 || !args.headless || args.frames > 0,
        "live cameras never end: expected --frames N with --headless");
}

}  // namespace

std::optional<Args> parse_args(int argc, char** argv) {
  Args args;
  CLI::App app{"Measures the light of a place with its cameras and shows a virtual object in it.",
               "fastibl-demo"};
  app.footer(
      "Examples:\n"
      "  fastibl-demo --recording my-recording\n"
      "  fastibl-demo --recording my-recording --object spot.obj --headless --out out.webm\n"
      "  fastibl-demo --back 0 --front 2 --rig rig.yaml --glossy 0.3,0.3,0.3");
  app.set_version_flag("--version", "fastibl-demo " FASTIBL_VERSION);

  app.add_option("--recording", args.recording, "folder with rig.yaml, board.yaml and frames.csv")
      ->type_name("DIR");
  app.add_option("--back", args.back, "number of the camera that sees the board")
      ->check(kNotNegative);
  app.add_option("--front", args.front, "number of the camera that looks the other way")
      ->check(kNotNegative);
  app.add_option("--rig", args.rig, "calibration of live cameras")->type_name("FILE");
  app.add_option("--board", args.board, "the printed board, where it is not the recording's")
      ->type_name("FILE");
  std::string poses = "track", up = "y", methods = "auto";
  app.add_option("--poses", poses, "follow the board, or take a recording's true poses")
      ->check(CLI::IsMember({"track", "truth"}))
      ->capture_default_str();

  app.add_option("--object", args.object, "mesh; a generated knot without")->type_name("FILE.obj");
  app.add_option("--height", args.height, "of the object in metres")
      ->check(kPositive)
      ->capture_default_str();
  app.add_option("--up", up, "upward axis of the mesh")
      ->check(CLI::IsMember({"y", "z"}))
      ->capture_default_str();
  std::vector<float> diffuse{0.55f, 0.5f, 0.45f}, glossy{0.25f, 0.25f, 0.25f};
  app.add_option("--diffuse", diffuse, "linear colour r,g,b")->expected(3)->delimiter(',');
  app.add_option("--glossy", glossy, "linear colour r,g,b")->expected(3)->delimiter(',');
  app.add_option("--exponent", args.material.exponent, "of the glossy lobe, 0 or more")
      ->check(kNotNegative)
      ->capture_default_str();

  app.add_option("--methods", methods, "the library's choice, or the paper's of 2014")
      ->check(CLI::IsMember({"auto", "paper"}))
      ->capture_default_str();
  app.add_option("--backend", args.backend, "cpu or gl")
      ->check(CLI::IsMember({"cpu", "gl"}))
      ->capture_default_str();
  app.add_flag_callback(
      "--no-shadow", [&] { args.cast_shadow = false; }, "cast no shadow");
  std::vector<float> shadow_color{0, 0, 0};
  app.add_option("--shadow-strength", args.shadow_look.strength, "0: none, 1: as it falls")
      ->check(kNotNegative)
      ->capture_default_str();
  app.add_option("--shadow-color", shadow_color, "linear colour r,g,b that a full shadow leaves")
      ->expected(3)
      ->delimiter(',');
  app.add_option("--threads", args.threads, "0: one a core")->check(kNotNegative);
  app.add_option("--frames", args.frames, "stop after so many pictures")->check(kPositive);
  app.add_flag("--headless", args.headless, "no window");
  app.add_option("--out", args.out,
                 "with --headless: video.webm, picture.png (the last one), or a "
                 "folder for a PNG of each")
      ->type_name("PATH");
  app.add_option("--screenshot", args.screenshot, "PNG of the window after the last picture")
      ->type_name("FILE.png");

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == int(CLI::ExitCodes::Success)) {  // help, version
      app.exit(error);
      return std::nullopt;
    }
    throw std::invalid_argument(error.what());
  }
  args.true_poses = poses == "truth";
  args.z_up = up == "z";
  args.paper = methods == "paper";
  args.material.diffuse = colour(diffuse), args.material.glossy = colour(glossy);
  args.material.validate();
  args.shadow_look.color = colour(shadow_color);
  args.shadow_look.validate();
  check_together(args);
  return args;
}

}  // namespace fastibl::demo
