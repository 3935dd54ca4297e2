#include "demo/headless.h"

#include <csignal>
#include <iostream>

#include "demo/commands.h"
#include "demo/output.h"
#include "demo/script.h"
#include "fastibl/core/check.h"

namespace fastibl::demo {
namespace {

void take_screenshot(Player& player) {
  if (player.screenshot.empty()) return;
  const std::filesystem::path path = std::exchange(player.screenshot, {});
  if (player.picture().empty()) return;
  write_png(path, player.picture());
  std::cout << "wrote " << path.string() << '\n';
}

volatile std::sig_atomic_t interrupted = 0;

// Ctrl-C, kill and closing the terminal end the run as --frames does, so what was written so far is
// complete. A second signal ends it at once.
void end_by_signals() {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    const auto before = std::signal(signal, [](int number) {
      interrupted = 1;
      std::signal(number, SIG_DFL);
    });
    if (signal == SIGHUP && before == SIG_IGN) std::signal(signal, SIG_IGN);  // nohup
  }
}

}  // namespace

bool run_headless(const Args& args) {
  end_by_signals();
  Player player(args, false);
  Output output(args.out, player.source().fps());
  Script script(args);
  while (args.frames == 0 || player.count() < args.frames) {
    script.before_frame(player);
    if (player.quit || interrupted) break;
    if (!player.advance()) {
      if (player.ended()) break;
      continue;
    }
    script.after_frame(player);
    player.timings().count_frame();
    const bool shows = player.picture_is_new();  // otherwise the frame only fed the map
    take_screenshot(player);
    if (shows) output.add(player.picture());
  }
  output.finish();
  const bool ended = player.quit || interrupted;  // by the user
  if (ended && player.count() == 0) return true;
  check(player.count() > 0, "no frame could be read");
  script.at_the_end(player);
  const bool all_came = script.all_came(player);
  take_screenshot(player);
  player.set_recording(false);
  player.timings().print(std::cout);
  if (player.unseen() > 0)
    std::cout << "the board was not seen in " << player.unseen() << " of " << player.count()
              << " frames\n";
  return all_came || ended;
}

}  // namespace fastibl::demo
