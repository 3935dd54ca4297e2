#include "demo/commands.h"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <optional>

#include "demo/overlays/format.h"
#include "fastibl/core/check.h"
#include "fastibl/core/parse_number.h"

namespace fastibl::demo {
namespace {

using Values = std::vector<std::string>;

Values off_on(const Player&) { return {"off", "on"}; }
std::string switched(bool on) { return on ? "on" : "off"; }

double number(const char* command, const std::string& text) {
  const std::optional<double> value = parse_number(text);
  check(value.has_value(), command, ": expected a number, got \"", text, '"');
  return *value;
}
std::string plain(float value) {  // the shortest text that reads back the same
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

// A step's methods: "auto" and the named ones.
template <auto& kAll>
Values method_names(const Player&) {
  Values names{"auto"};
  for (const auto method : kAll) names.emplace_back(name(method));
  return names;
}
template <auto Member>
std::string method_of(const Player& player) {
  return std::string(name(player.methods().*Member));
}
template <auto Member, auto Parse>
void set_method(Player& player, const std::string& value) {
  Methods methods = player.methods();
  methods.*Member = Parse(value);
  player.set_methods(methods);
}

std::string new_name(const std::string& stem) {
  std::string name = stem + ".png";
  for (int k = 2; std::filesystem::exists(name); ++k)
    name = stem + "-" + std::to_string(k) + ".png";
  return name;
}

template <std::size_t K>
Command overlay_command() {
  return {"show",
          kOverlays[K].name,
          kOverlays[K].key,
          kOverlays[K].help,
          off_on,
          [](const Player& p) { return switched(p.overlay(K)); },
          [](Player& p, const std::string& v) { p.set_overlay(K, v == "on"); }};
}

std::vector<Command> make_commands() {
  return {
      overlay_command<0>(),
      overlay_command<1>(),
      overlay_command<2>(),
      overlay_command<3>(),
      overlay_command<4>(),
      overlay_command<5>(),
      {"show", "interface", "tab", "the panel with all of this", off_on,
       [](const Player& p) { return switched(p.show_interface); },
       [](Player& p, const std::string& v) { p.show_interface = v == "on"; }},
      {"show", "help", "h", "this list (F1, too)", off_on,
       [](const Player& p) { return switched(p.show_help); },
       [](Player& p, const std::string& v) { p.show_help = v == "on"; }},

      {"object", "object", "o", "what is shown: built in, or an OBJ file",
       [](const Player& p) { return p.objects(); }, [](const Player& p) { return p.object(); },
       [](Player& p, const std::string& v) { p.set_object(v); }, true},
      {"object", "material", "k", "what it is made of",
       [](const Player&) { return material_names(); }, [](const Player& p) { return p.material(); },
       [](Player& p, const std::string& v) { p.set_material(v); }},
      {"object", "height", "v", "of the object, metres",
       [](const Player&) {
         return Values{"0.06", "0.12", "0.2"};
       },
       [](const Player& p) { return plain(float(p.height())); },
       [](Player& p, const std::string& v) { p.set_height(number("height", v)); }, true},
      {"object", "turn-left", ",", "turns the object by 15 degrees", nullptr, nullptr,
       [](Player& p, const std::string&) { p.turn(15); }},
      {"object", "turn-right", ".", "the other way", nullptr, nullptr,
       [](Player& p, const std::string&) { p.turn(-15); }},
      {"object", "shadow", "s", "whether it casts one", off_on,
       [](const Player& p) { return switched(p.options().cast_shadow); },
       [](Player& p, const std::string& v) { p.set_cast_shadow(v == "on"); }},
      {"object", "shadow-strength", "w", "1: as it falls, 0: none",
       [](const Player&) {
         return Values{"1", "0.75", "0.5", "0.25", "0"};
       },
       [](const Player& p) { return plain(p.shadow_look().strength); },
       [](Player& p, const std::string& v) { p.set_shadow_strength(number("shadow-strength", v)); },
       true},

      {"methods", "methods", "m", "the library's choice, or the paper's of 2014",
       [](const Player&) {
         return Values{"auto", "paper"};
       },
       [](const Player& p) { return std::string(p.paper() ? "paper" : "auto"); },
       [](Player& p, const std::string& v) {
         p.set_methods(v == "paper" ? Methods::paper() : Methods{});
       }},
      {"methods", "tracking", "t", "of the board", method_names<kTrackingMethods>,
       method_of<&Methods::tracking>, set_method<&Methods::tracking, tracking_method>},
      {"methods", "diffuse", "d", "irradiance", method_names<kDiffuseMethods>,
       method_of<&Methods::diffuse>, set_method<&Methods::diffuse, diffuse_method>},
      {"methods", "glossy", "g", "glossy look-up", method_names<kGlossyMethods>,
       method_of<&Methods::glossy>, set_method<&Methods::glossy, glossy_method>},
      {"methods", "shadow-method", "f", "shadow on the plane", method_names<kShadowMethods>,
       method_of<&Methods::shadow>, set_method<&Methods::shadow, shadow_method>},
      {"methods", "self-shadow", "a", "what the object hides of its own light",
       [](const Player& p) {
         Values values = method_names<kSelfShadowMethods>(p);
         for (const SelfShadowMethod method : kSelfShadowMethods)
           if (!p.has(method)) std::erase(values, name(method));
         return values;
       },
       method_of<&Methods::self_shadow>, set_method<&Methods::self_shadow, self_shadow_method>},
      {"methods", "bounce", "u", "light between object and plane", method_names<kBounceMethods>,
       method_of<&Methods::bounce>, set_method<&Methods::bounce, bounce_method>},
      {"methods", "backend", "b", "where it is drawn",
       [](const Player&) {
         return Values{"cpu", "gl"};
       },
       [](const Player& p) { return p.backend(); },
       [](Player& p, const std::string& v) { p.set_backend(v); }},

      {"budget", "error", "e", "error that the plan aims at, % (0: none)",
       [](const Player&) { return Values{"0", "0.5", "1", "2", "5", "10"}; },
       [](const Player& p) { return plain(float(100 * p.options().error)); },
       [](Player& p, const std::string& v) {
         p.set_budgets(number("error", v) / 100, p.options().milliseconds);
       },
       true},
      {"budget", "milliseconds", "i", "processor time for a frame (0: any)",
       [](const Player&) {
         return Values{"0", "5", "10", "20", "33"};
       },
       [](const Player& p) { return plain(float(p.options().milliseconds)); },
       [](Player& p, const std::string& v) {
         p.set_budgets(p.options().error, number("milliseconds", v));
       },
       true},

      {"run", "freeze", "space", "holds the frame; all can be changed", off_on,
       [](const Player& p) { return switched(p.frozen); },
       [](Player& p, const std::string& v) { p.frozen = v == "on"; }},
      {"run", "step", "n", "one frame further", nullptr, nullptr,
       [](Player& p, const std::string&) { p.frozen = p.step = true; }},
      {"run", "lamp", "l", "the simulated room's lamp", off_on,
       [](const Player& p) { return switched(p.lamp()); },
       [](Player& p, const std::string& v) {
         check(p.source().has_lamp(), "lamp: only the simulated room has one");
         p.set_lamp(v == "on");
       }},
      {"run", "record", "r", "the cameras' pictures, as a recording", off_on,
       [](const Player& p) { return switched(p.recording()); },
       [](Player& p, const std::string& v) { p.set_recording(v == "on"); }},
      {"run", "screenshot", "p", "what is shown, as a PNG", nullptr, nullptr,
       [](Player& p, const std::string& v) {
         p.screenshot = v.empty() ? new_name("fastibl-" + std::to_string(p.count())) : v;
       },
       true},
      {"run", "restart", "c", "forgets the map; files begin again", nullptr, nullptr,
       [](Player& p, const std::string&) { p.restart(); }},
      {"run", "quit", "q", "ends the program (Esc, too)", nullptr, nullptr,
       [](Player& p, const std::string&) { p.quit = true; }}};
}

std::string next_choice(const Player& player, const Command& command) {
  const Values choices = command.choices(player);
  const auto at = std::find(choices.begin(), choices.end(), command.current(player));
  return at == choices.end() || at + 1 == choices.end() ? choices.front() : *(at + 1);
}

}  // namespace

std::span<const Command> commands() {
  static const std::vector<Command> all = make_commands();
  return all;
}

bool is_toggle(const Command& command, const Player& player) {
  return command.choices && command.choices(player) == off_on(player);
}

namespace {

void run_with(Player& player, const Command& command, const std::string& value) {
  if (!command.choices) {
    check(value.empty() || command.free_value, command.name, " takes no value, got \"", value, '"');
    return command.run(player, value);
  }
  if (value.empty()) return command.run(player, next_choice(player, command));
  const Values choices = command.choices(player);
  if (!command.free_value && std::find(choices.begin(), choices.end(), value) == choices.end()) {
    std::string all;
    for (const std::string& choice : choices) all += (all.empty() ? "" : ", ") + choice;
    check(false, command.name, " must be one of ", all, "; got \"", value, '"');
  }
  command.run(player, value);
}

}  // namespace

void run(Player& player, const Command& command, const std::string& value) {
  run_with(player, command, value);
  // Commands that make an object or a recording print messages of their own.
  if (command.choices && command.name != "object" && command.name != "height" &&
      command.name != "record")
    player.say(std::string(command.name) + ": " + command.current(player));
}

bool press(Player& player, std::string_view key) {
  for (const Command& command : commands())
    if (command.key == key && !key.empty()) return run(player, command), true;
  return false;
}

std::vector<std::string> help_lines() {
  std::vector<std::string> lines;
  for (const Command& c : commands())
    lines.push_back(padded(std::string(c.key), 7) + padded(std::string(c.name), 17) +
                    std::string(c.help));
  return lines;
}

std::vector<std::string> help_cells() {
  std::vector<std::string> lines;
  for (const Command& c : commands())
    lines.push_back(std::string(c.key) + "\t" + std::string(c.name) + "\t" + std::string(c.help));
  return lines;
}

Order parse_order(const std::string& text) {
  const std::size_t mark = text.find('=');
  const std::string name = text.substr(0, mark);
  std::string all;
  for (const Command& command : commands()) {
    if (command.name == name)
      return {&command, mark == std::string::npos ? "" : text.substr(mark + 1)};
    all += (all.empty() ? "" : ", ") + std::string(command.name);
  }
  check(false, "no command \"", name, "\"; there are: ", all);
  return {};
}

}  // namespace fastibl::demo
