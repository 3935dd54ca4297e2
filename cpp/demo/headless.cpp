#include "demo/headless.h"

#include <iostream>
#include <thread>

#include "demo/commands.h"
#include "demo/output.h"
#include "demo/script.h"

namespace fastibl::demo {
namespace {

void take_screenshot(Player& player) {
  if (player.screenshot.empty()) return;
  const std::filesystem::path path = std::exchange(player.screenshot, {});
  if (player.picture().empty()) return;
  write_png(path, player.picture());
  std::cout << "wrote " << path.string() << '\n';
}

}  // namespace

void run_headless(const Args& args) {
  Player player(args, false);
  Output output(args.out, player.source().fps());
  Script script(args);
  while (args.frames == 0 || player.count() < args.frames) {
    script.before_frame(player);
    if (player.quit) break;
    if (!player.advance()) {
      if (player.ended()) break;
      continue;
    }
    script.after_frame(player);
    player.timings().count_frame();
    take_screenshot(player);
    if (!player.picture_is_new()) continue;  // it fed the map; there is no picture to show
    output.add(player.picture());
  }
  output.finish();
  check(player.count() > 0, "no frame could be read");
  script.at_the_end(player);
  take_screenshot(player);
  player.set_recording(false);
  player.timings().print(std::cout);
  if (player.unseen() > 0)
    std::cout << "the board was not seen in " << player.unseen() << " of " << player.count()
              << " frames\n";
}

}  // namespace fastibl::demo
