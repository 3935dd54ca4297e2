#include "demo/interface.h"

#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>
#include <imgui_stdlib.h>

#include "demo/commands.h"
#include "demo/overlays/format.h"

namespace fastibl::demo {
namespace {

std::string label_of(const Command& command) {
  std::string label(command.name);
  if (!command.key.empty()) label += " (" + std::string(command.key) + ")";
  return label;
}

void explain(const Command& command) {
  if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", std::string(command.help).c_str());
}

// Shows an error as a message instead of passing it on, because a person is watching.
void do_it(Player& player, const Command& command, const std::string& value) {
  try {
    run(player, command, value);
  } catch (const std::exception& error) {
    player.say(error.what());
  }
}

void choose(Player& player, const Command& command) {
  const std::string current = command.current(player);
  ImGui::SetNextItemWidth(150);
  if (ImGui::BeginCombo(label_of(command).c_str(), current.c_str())) {
    for (const std::string& choice : command.choices(player))
      if (ImGui::Selectable(choice.c_str(), choice == current)) do_it(player, command, choice);
    ImGui::EndCombo();
  }
  explain(command);
}

void show_control(Player& player, const Command& command) {
  if (!command.choices) {
    if (ImGui::Button(label_of(command).c_str())) do_it(player, command, "");
    explain(command);
  } else if (is_toggle(command, player)) {
    bool on = command.current(player) == "on";
    if (ImGui::Checkbox(label_of(command).c_str(), &on)) do_it(player, command, on ? "on" : "off");
    explain(command);
  } else {
    choose(player, command);
  }
}

}  // namespace

Interface::Interface(GLFWwindow* window, bool desktop_gl) {
  if (!desktop_gl) return;
  ImGui::CreateContext();
  ImGui::GetIO().IniFilename = nullptr;  // no file is left behind
  ImGui::StyleColorsDark();
  ImGui::GetStyle().WindowBorderSize = 0;
  usable_ = ImGui_ImplGlfw_InitForOpenGL(window, true);
  if (!usable_) return;
  usable_ = ImGui_ImplOpenGL3_Init("#version 330 core") && ImGui_ImplOpenGL3_CreateDeviceObjects();
}

Interface::~Interface() {
  if (!ImGui::GetCurrentContext()) return;
  if (usable_) ImGui_ImplOpenGL3_Shutdown(), ImGui_ImplGlfw_Shutdown();
  ImGui::DestroyContext();
}

void Interface::build_group(Player& player, std::string_view group) {
  const std::string title(group);
  // The methods are closed at first: there are many, and the plan chooses them well.
  const auto open = group == "methods" ? ImGuiTreeNodeFlags_None : ImGuiTreeNodeFlags_DefaultOpen;
  if (!ImGui::CollapsingHeader(title.c_str(), open)) return;
  int in_row = 0;
  bool small_before = false;
  for (const Command& command : commands()) {
    if (command.group != group) continue;
    if (command.name == "lamp" && !player.source().has_lamp()) continue;
    const bool is_small = !command.choices || is_toggle(command, player);
    if (small_before && is_small && in_row % 2 == 1) ImGui::SameLine(150);
    in_row = is_small && small_before ? in_row + 1 : 1;
    small_before = is_small;
    show_control(player, command);
  }
}

void Interface::build(Player& player) {
  if (!usable_) return;
  ImGui_ImplGlfw_NewFrame();
  ImGui::NewFrame();
  const float height = ImGui::GetIO().DisplaySize.y;
  ImGui::SetNextWindowPos({0, 0});
  ImGui::SetNextWindowSize({float(kWidth), height});
  ImGui::Begin(
      "fastibl", nullptr,
      ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoSavedSettings);
  ImGui::Text("%s frames/s, %s ms of session",
              fixed(player.timings().frames_per_second(), 1).c_str(),
              fixed(player.timings().recent("total"), 1).c_str());
  std::string_view group;
  for (const Command& command : commands()) {
    if (command.group == group) continue;
    group = command.group;
    build_group(player, group);
    if (group != "object") continue;
    ImGui::SetNextItemWidth(150);
    ImGui::PushAllowKeyboardFocus(false);  // Tab hides the panel instead of going to a field
    const bool entered = ImGui::InputText("##file", &file_, ImGuiInputTextFlags_EnterReturnsTrue);
    ImGui::PopAllowKeyboardFocus();
    ImGui::SameLine();
    if ((ImGui::Button("load OBJ file") || entered) && !file_.empty())
      do_it(player, *parse_order("object").command, file_);
  }
  ImGui::End();
  ImGui::Render();
  built_ = true;
}

void Interface::render() {
  if (built_) ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

bool Interface::takes_keys() const { return usable_ && ImGui::GetIO().WantTextInput; }

}  // namespace fastibl::demo
