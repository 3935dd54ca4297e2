// All commands that can be given while the program runs, defined once: keys, help, the interface
// and scripts are made from this table.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "demo/player.h"

namespace fastibl::demo {

struct Command {
  std::string_view group, name;
  std::string_view key;  // a letter, "space", "tab" or ",", as shown to people; empty: none
  std::string_view help;
  // The values to choose from; null: an action without a value.
  std::vector<std::string> (*choices)(const Player&) = nullptr;
  std::string (*current)(const Player&) = nullptr;
  void (*run)(Player&, const std::string& value) = nullptr;
  bool free_value = false;  // values other than the choices are accepted, too
};

std::span<const Command> commands();

// value: if empty, the next choice is taken. Throws std::invalid_argument for a value that does not
// exist.
void run(Player& player, const Command& command, const std::string& value = {});
// Returns false if no command has that key.
bool press(Player& player, std::string_view key);
bool is_toggle(const Command& command, const Player& player);  // whether its choices are off and on

// One line per command: key, name, what it does.
std::vector<std::string> help_lines();  // as wide as their words
std::vector<std::string> help_cells();  // separated by tabs

// "NAME" or "NAME=VALUE"; throws std::invalid_argument that names all commands.
struct Order {
  const Command* command;
  std::string value;
};
Order parse_order(const std::string& text);

}  // namespace fastibl::demo
