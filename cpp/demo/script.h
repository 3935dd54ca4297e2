// Commands and the screenshot that the arguments ask for at certain frames.
#pragma once

#include "demo/commands.h"

namespace fastibl::demo {

class Script {
 public:
  explicit Script(const Args& args) : args_(args) {}

  void before_frame(Player& player);  // the one that advance() takes next
  void after_frame(Player& player);
  void at_the_end(Player& player);
  // Tells on stderr of commands and a screenshot whose frame never came.
  bool all_came(const Player& player) const;

 private:
  const Args& args_;
  int given_for_ = 0;  // frame before which commands were given
};

}  // namespace fastibl::demo
