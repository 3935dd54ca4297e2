// What the user asked for.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "fastibl/scene/material.h"
#include "fastibl/scene/shadow_look.h"

namespace fastibl::demo {

struct Args {
  std::filesystem::path recording;  // or
  int back = -1, front = -1;        // camera numbers, with
  std::filesystem::path rig, board;
  bool true_poses = false;  // from the recording's truth instead of tracking

  std::filesystem::path object;  // empty: the built-in knot
  double height = 0.12;          // metres
  bool z_up = false;
  Material material;

  bool paper = false;
  std::string backend = "cpu";
  bool cast_shadow = true;
  ShadowLook shadow_look;
  int threads = 0;  // 0: all cores
  int frames = 0;   // 0: to the end

  bool headless = false;
  std::filesystem::path out;         // .webm, .png, or a folder
  std::filesystem::path screenshot;  // of the window
};

// Nothing where help or the version was asked for and printed. Throws std::invalid_argument that
// says what was expected and what came.
std::optional<Args> parse_args(int argc, char** argv);

}  // namespace fastibl::demo
