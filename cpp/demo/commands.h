// All that can be done while the program runs, once: keys, help, the interface and scripts are made
// from this table.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "demo/player.h"

namespace fastibl::demo {

struct Command {
  std::string_view group, name;
  std::string_view key;  // a letter, "space", "tab" or "," as people read it; empty: none
  std::string_view help;
  // Values to choose from; null: an action without one.
  std::vector<std::string> (*choices)(const Player&) = nullptr;
  std::string (*current)(const Player&) = nullptr;
  void (*run)(Player&, const std::string& value) = nullptr;
  bool free_value = false;  // others than the choices are taken, too
};

std::span<const Command> commands();

// value: empty takes the next choice. Throws std::invalid_argument for one that there is not.
void run(Player& player, const Command& command, const std::string& value = {});
// False where no command has that key.
bool press(Player& player, std::string_view key);
bool is_toggle(const Command& command, const Player& player);  // its choices are off and on

// One line a command: key, name, what it does.
std::vector<std::string> help_lines();  // as wide as their words
std::vector<std::string> help_cells();  // parted by tabs

// "NAME" or "NAME=VALUE"; throws std::invalid_argument that names all commands.
struct Order {
  const Command* command;
  std::string value;
};
Order parse_order(const std::string& text);

}  // namespace fastibl::demo
