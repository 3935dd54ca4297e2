#include "demo/args.h"

#include <CLI/CLI.hpp>
#include <charconv>
#include <cmath>
#include <vector>

#include "demo/commands.h"
#include "demo/output.h"
#include "fastibl/core/check.h"
#include "fastibl/shading/supersample.h"

namespace fastibl::demo {
namespace {

// Used instead of CLI11's own checks, whose messages print the range of double.
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
  const int sources = args.simulate + !args.recording.empty() + !args.back.empty();
  check(sources == 1, "expected one of --simulate, --recording DIR and --back CAMERA, got ",
        sources == 0 ? "none" : "several");
  if (!args.back.empty()) {
    check(!args.rig.empty(), "live cameras need their calibration: expected --rig rig.yaml");
    check(!args.true_poses, "--poses truth needs a recording or --simulate, got --back ",
          args.back);
  }
  check(args.front.empty() || !args.back.empty(), "--front ", args.front, " needs --back CAMERA");
  check(args.rig.empty() || !args.back.empty(), "--rig is of cameras: ", args.rig.string(),
        " needs --back CAMERA");
  check_folder_of(args.screenshot, "--screenshot");
  check(args.headless || args.out.empty(), "--out is for --headless; use --screenshot in a window");
  check(args.recording.empty() == false || !args.headless || args.frames > 0,
        "live cameras and the simulator never end: expected --frames N with --headless");
  check(args.at == 0 || !args.screenshot.empty(), "--at ", args.at, " needs --screenshot FILE.png");
  for (const int edge : args.size)
    check(edge >= 64 && edge <= 4096, "--size must be WxH, each from 64 to 4096, got ",
          args.size[0], "x", args.size[1]);
}

// text: such as "30:material=gold".
Cue parse_cue(const std::string& text) {
  Cue cue;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, cue.frame);
  check(error == std::errc{} && stop != end && *stop == ':' && cue.frame >= 1,
        "--do: expected FRAME:COMMAND, as in 30:material=gold; got \"", text, '"');
  cue.order.assign(stop + 1, end);
  const Order order = parse_order(cue.order);
  if (order.command->name == "screenshot") check_folder_of(order.value, "screenshot");
  return cue;
}

std::vector<std::string> overlay_names() {
  std::vector<std::string> names;
  for (const Overlay& overlay : kOverlays) names.emplace_back(overlay.name);
  return names;
}

std::string footer() {
  std::string text =
      "Examples:\n"
      "  fastibl-demo --simulate\n"
      "  fastibl-demo --recording my-recording --object spot.obj --headless --out out.webm\n"
      "  fastibl-demo --back 0 --front 2 --rig rig.yaml --material chrome\n"
      "  fastibl-demo --simulate --headless --frames 90 --overlay map,lights,plan \\\n"
      "      --do 30:material=gold --do 60:lamp=on --screenshot out.png --at 80\n"
      "\nKeys, and commands for --do FRAME:NAME=VALUE:\n";
  for (const std::string& line : help_lines()) text += "  " + line + "\n";
  return text;
}

}  // namespace

std::optional<Args> parse_args(int argc, char** argv) {
  Args args;
  CLI::App app{"Measures the light of a place with its cameras and shows a virtual object in it.",
               "fastibl-demo"};
  app.footer(footer());
  app.set_version_flag("--version", "fastibl-demo " FASTIBL_VERSION);

  app.add_option("--recording", args.recording, "folder with rig.yaml, board.yaml and frames.csv")
      ->type_name("DIR");
  app.add_flag("--simulate", args.simulate, "a simulated room and rig: needs no files");
  app.add_option("--back", args.back, "the camera that sees the board: number, file or address")
      ->type_name("CAMERA");
  app.add_option("--front", args.front, "the camera that looks the other way")->type_name("CAMERA");
  app.add_option("--rig", args.rig, "calibration of live cameras")->type_name("FILE");
  app.add_option("--board", args.board, "the printed board, where it is not the recording's")
      ->type_name("FILE");
  std::string poses = "track", up = "y", methods = "auto";
  app.add_option("--poses", poses, "follow the board, or take the recording's or the simulator's")
      ->check(CLI::IsMember({"track", "truth"}))
      ->capture_default_str();

  app.add_option("--size", args.size, "of simulated pictures, as 640x480")
      ->type_name("WxH")
      ->delimiter('x');

  app.add_option("--object", args.objects, "mesh, or knot, ball, steps; may be given several times")
      ->type_name("FILE.obj")
      ->take_all();
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

  app.add_option("--material", args.material_name, "a built-in one instead")
      ->check(CLI::IsMember(material_names()));

  app.add_option("--methods", methods, "the library's choice, or the paper's of 2014")
      ->check(CLI::IsMember({"auto", "paper"}))
      ->capture_default_str();
  double percent = 100 * args.error;
  app.add_option("--error", percent, "that the plan aims at, %; 0: none")
      ->check(kNotNegative)
      ->capture_default_str();
  app.add_option("--milliseconds", args.milliseconds, "processor time for a frame; 0: any")
      ->check(kNotNegative);
  app.add_option("--supersampling", args.supersampling,
                 "draw the object so many times as large along each axis and average")
      ->check(CLI::Range(1, kMostSupersampling))
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
  app.add_option("--overlay", args.overlays, "any of pose,map,lights,shadow-map,timings,plan")
      ->type_name("NAMES")
      ->delimiter(',')
      ->check(CLI::IsMember(overlay_names()));
  std::vector<std::string> cues;
  app.add_option("--do", cues, "a command below before a frame, from 1 on; several times")
      ->type_name("FRAME:COMMAND")
      ->take_all();
  app.add_option("--record", args.record, "stores the cameras' pictures as a recording")
      ->type_name("DIR");
  app.add_option("--screenshot", args.screenshot, "PNG of what is shown at --at")
      ->type_name("FILE.png");
  app.add_option("--at", args.at, "frame of the screenshot, from 1 on; the last without")
      ->check(kPositive);
  app.add_flag_callback(
      "--no-interface", [&] { args.interface = false; }, "a window without the panel");
  app.add_flag_callback(
      "--no-pace", [&] { args.pace = false; },
      "a window that plays as fast as it can, not as frames were taken");

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
  args.error = percent / 100;
  for (const std::string& cue : cues) args.cues.push_back(parse_cue(cue));
  args.material.diffuse = colour(diffuse), args.material.glossy = colour(glossy);
  args.material.validate();
  args.shadow_look.color = colour(shadow_color);
  args.shadow_look.validate();
  check_together(args);
  return args;
}

}  // namespace fastibl::demo
