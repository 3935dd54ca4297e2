// Gives the commands and takes the screenshot that the arguments ask for at certain frames.
#pragma once

#include "demo/commands.h"

namespace fastibl::demo {

class Script {
 public:
  explicit Script(const Args& args) : args_(args) {}

  void before_frame(Player& player);  // the frame that advance() takes next
  void after_frame(Player& player);
  void at_the_end(Player& player);
  // Returns false, and reports on stderr, if the frame of a command or of the screenshot never
  // came.
  bool all_came(const Player& player) const;

 private:
  const Args& args_;
  int given_for_ = 0;  // frame before which commands were given last
};

}  // namespace fastibl::demo
