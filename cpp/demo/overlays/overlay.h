// What can be drawn over a frame, both in a window and without one.
#pragma once

#include <array>
#include <string_view>

#include "demo/frame_source.h"
#include "demo/overlays/canvas.h"
#include "demo/timings.h"
#include "fastibl/render/session.h"

namespace fastibl::demo {

// What overlays read; the references are valid during the call.
struct View {
  const Rig& rig;
  const std::optional<Board>& board;  // that is tracked
  const OwnedFrame& frame;
  const FrameResult& result;
  Session& session;
  const Timings& timings;
  const CubeMap* true_light;  // null: unknown
};

// Each takes its own place on the canvas.
void draw_pose(Canvas& canvas, const View& view);
void draw_map(Canvas& canvas, const View& view);
void draw_lights(Canvas& canvas, const View& view);
void draw_shadow_map(Canvas& canvas, const View& view);
void draw_timings(Canvas& canvas, const View& view);
void draw_plan(Canvas& canvas, const View& view);

struct Overlay {
  std::string_view name, key, help;
  void (*draw)(Canvas&, const View&);
};
inline constexpr std::array kOverlays = {
    Overlay{"pose", "1", "axes of the board, its tags, how well it is tracked", draw_pose},
    Overlay{"map", "2", "captured map; striped: unseen; where to look next", draw_map},
    Overlay{"lights", "3", "main lights: arrows towards them, and their shares", draw_lights},
    Overlay{"shadow-map", "4", "shadow on the plane, seen from above", draw_shadow_map},
    Overlay{"timings", "5", "time of each pass, and of the program itself", draw_timings},
    Overlay{"plan", "6", "what runs, by which method, how wrong it is", draw_plan}};

}  // namespace fastibl::demo
