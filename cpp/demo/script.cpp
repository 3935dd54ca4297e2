#include "demo/script.h"

#include <iostream>
#include <string>

namespace fastibl::demo {

void Script::before_frame(Player& player) {
  const int frame = player.count() + 1;
  if (given_for_ == frame) return;  // no picture came since the last call
  given_for_ = frame;
  for (const Cue& cue : args_.cues) {
    if (cue.frame != frame) continue;
    const Order order = parse_order(cue.order);
    run(player, *order.command, order.value);
  }
}

void Script::after_frame(Player& player) {
  if (args_.at > 0 && player.count() == args_.at) player.screenshot = args_.screenshot;
}

bool Script::all_came(const Player& player) const {
  bool all = true;
  const auto tell = [&](const std::string& what) {
    all = false;
    std::cerr << "fastibl-demo: " << what << " never came: there were " << player.count()
              << " frames\n";
  };
  for (const Cue& cue : args_.cues)
    if (cue.frame > player.count()) tell("frame " + std::to_string(cue.frame) + " of " + cue.order);
  if (args_.at > player.count()) tell("frame " + std::to_string(args_.at) + " of the screenshot");
  return all;
}

void Script::at_the_end(Player& player) {
  if (!args_.screenshot.empty() && args_.at == 0) player.screenshot = args_.screenshot;
}

}  // namespace fastibl::demo
