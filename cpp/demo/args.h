// What the user asked for.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "fastibl/scene/material.h"
#include "fastibl/scene/shadow_look.h"

namespace fastibl::demo {

// A command at a frame, such as "30:material=gold".
struct Cue {
  int frame = 0;  // the command is given before this frame; counted from 1
  std::string order;
};

struct Args {
  bool simulate = false;            // or
  std::filesystem::path recording;  // or
  std::string back, front;          // cameras: numbers, files or addresses, with
  std::filesystem::path rig, board;
  std::array<int, 2> size{640, 480};  // size of simulated pictures
  bool true_poses = false;  // given by the recording or the simulator, instead of tracking

  std::vector<std::filesystem::path> objects;  // empty: the built-in knot
  double height = 0.12;                        // metres
  bool z_up = false;
  Material material;
  std::string material_name;  // one of the built-in ones; empty: `material`

  bool paper = false;
  double error = 0.02, milliseconds = 0;  // budgets
  int supersampling = 1;
  std::string backend = "cpu";
  bool cast_shadow = true;
  ShadowLook shadow_look;
  int threads = 0;  // 0: all cores
  int frames = 0;   // 0: to the end

  std::vector<std::string> overlays;
  std::vector<Cue> cues;
  bool headless = false, interface = true;
  bool pace = true;           // a window plays frames no faster than they were taken
  std::filesystem::path out;  // .webm, .png, or a folder
  std::filesystem::path record;
  std::filesystem::path screenshot;
  int at = 0;  // frame of the screenshot; 0: the last
};

// Returns nothing if help or the version was asked for and printed. Throws std::invalid_argument
// that says what was expected and what was given.
std::optional<Args> parse_args(int argc, char** argv);

}  // namespace fastibl::demo
