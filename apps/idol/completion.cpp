// Completion scripts, made of the commands and options that there are.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <memory>
#include <string>
#include <vector>

#include "commands.hpp"

namespace idol::cli {
namespace {

std::vector<const CLI::Option*> long_options(const CLI::App& command) {
  return command.get_options([](const CLI::Option* option) { return !option->get_lnames().empty(); });
}

std::string bash_completion(const CLI::App& app) {
  std::string commands, cases;
  for (const CLI::App* command : app.get_subcommands({})) {
    commands += command->get_name() + " ";
    std::vector<std::string> names;
    for (const CLI::Option* option : long_options(*command)) names.push_back("--" + option->get_lnames()[0]);
    cases += fmt::format("    {}) words='{}' ;;\n", command->get_name(), fmt::join(names, " "));
  }
  return fmt::format(R"(# bash completion of idol; made by 'idol completion bash'
_idol() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} words=
  case ${{COMP_WORDS[1]}} in
{}  esac
  ((COMP_CWORD == 1)) && words='{}--help --version'
  COMPREPLY=()
  if ((COMP_CWORD == 1)) || [[ $current == -* ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
  fi
}}
complete -o default -F _idol idol
)",
                     cases, commands);
}

/// Within single quotes and brackets.
std::string for_zsh(const std::string& text) {
  std::string safe;
  for (const char c : text) {
    if (c == '\'') continue;
    if (c == '[' || c == ']' || c == ':') safe += '\\';
    safe += c;
  }
  return safe;
}

std::string zsh_completion(const CLI::App& app) {
  std::string commands, cases;
  for (const CLI::App* command : app.get_subcommands({})) {
    commands += fmt::format("    '{}:{}'\n", command->get_name(), for_zsh(command->get_description()));
    cases += fmt::format("    {})\n      _arguments", command->get_name());
    for (const CLI::Option* option : long_options(*command)) {
      cases += fmt::format(" \\\n        '--{}[{}]{}'", option->get_lnames()[0],
                           for_zsh(option->get_description()),
                           option->get_items_expected_max() > 0 ? ":value:_files" : "");
    }
    cases += " \\\n        '*:file:_files' ;;\n";
  }
  return fmt::format(R"(#compdef idol
# zsh completion of idol; made by 'idol completion zsh'
_idol() {{
  local -a commands=(
{}  )
  if ((CURRENT == 2)); then
    _describe command commands
    return
  fi
  local command=$words[2]
  shift words
  ((CURRENT--))
  case $command in
{}  esac
}}
_idol "$@"
)",
                     commands, cases);
}

}  // namespace

void add_completion(CLI::App& app, Action& action) {
  auto shell = std::make_shared<std::string>();
  auto* command = app.add_subcommand("completion", "Print a script for completion with the tab key");
  command->add_option("SHELL", *shell, "bash or zsh")->required()->check(CLI::IsMember({"bash", "zsh"}));
  command->footer("Examples:\n  source <(idol completion bash)\n  idol completion zsh > ~/.zfunc/_idol");
  command->callback([&app, &action, shell] {
    action = [&app, shell] {
      fmt::print("{}", *shell == "bash" ? bash_completion(app) : zsh_completion(app));
      return 0;
    };
  });
}

}  // namespace idol::cli
