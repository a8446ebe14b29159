#include "idol/base/options.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace detail {
namespace {

template <class T>
void parse_number(const std::string& text, Range range, T& out) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size())
    throw UsageError(fmt::format("'{}' is not {} number", text, std::is_integral_v<T> ? "a whole" : "a"));
  const auto number = static_cast<double>(value);
  if (!(number >= range.min && number <= range.max))
    throw UsageError(fmt::format("{} is outside {} to {}", text, range.min, range.max));
  out = value;
}

}  // namespace

void parse_option(const std::string& text, Range, bool& out) {
  if (text == "true" || text == "1" || text == "on" || text == "yes") {
    out = true;
  } else if (text == "false" || text == "0" || text == "off" || text == "no") {
    out = false;
  } else {
    throw UsageError(fmt::format("'{}' is neither true nor false", text));
  }
}
void parse_option(const std::string& text, Range range, int& out) { parse_number(text, range, out); }
void parse_option(const std::string& text, Range range, double& out) { parse_number(text, range, out); }

int parse_name(const std::string& text, std::span<const std::string_view> names) {
  const auto found = std::find(names.begin(), names.end(), text);
  if (found == names.end())
    throw UsageError(fmt::format("'{}' is none of {}", text, fmt::join(names, ", ")));
  return static_cast<int>(found - names.begin());
}

std::string format_option(bool value) { return value ? "true" : "false"; }
std::string format_option(int value) { return fmt::format("{}", value); }
std::string format_option(double value) { return fmt::format("{}", value); }

}  // namespace detail

void set_option(const std::vector<OptionField>& fields, const std::string& name, const std::string& value,
                const std::string& where) {
  const auto field = std::find_if(fields.begin(), fields.end(), [&](const auto& f) { return f.name == name; });
  if (field == fields.end())
    throw UsageError(fmt::format("{}: unknown option '{}'; 'idol config' lists all", where, name));
  try {
    field->set(value);
  } catch (const UsageError& e) {
    throw UsageError(fmt::format("{}: {}: {}", where, name, e.what()));
  }
}

namespace {

void apply_node(const std::vector<OptionField>& fields, const YAML::Node& node, const std::string& prefix,
                const std::string& file) {
  for (const auto& entry : node) {
    const std::string name = prefix + entry.first.as<std::string>();
    const std::string where = fmt::format("{}:{}", file, entry.first.Mark().line + 1);
    if (entry.second.IsMap()) {
      apply_node(fields, entry.second, name + ".", file);
    } else if (entry.second.IsScalar()) {
      set_option(fields, name, entry.second.as<std::string>(), where);
    } else {
      throw UsageError(fmt::format("{}: {}: expected a single value", where, name));
    }
  }
}

}  // namespace

void load_options(const std::vector<OptionField>& fields, const std::filesystem::path& path) {
  YAML::Node root;
  try {
    root = YAML::LoadFile(path.string());
  } catch (const YAML::BadFile&) {
    throw DataError(fmt::format("{}: cannot be read", path.string()));
  } catch (const YAML::ParserException& e) {
    throw UsageError(fmt::format("{}:{}: {}", path.string(), e.mark.line + 1, e.msg));
  }
  if (root.IsNull()) return;
  if (!root.IsMap()) throw UsageError(fmt::format("{}:1: expected groups of 'name: value'", path.string()));
  apply_node(fields, root, "", path.string());
}

std::string dump_options(const std::vector<OptionField>& fields) {
  std::string out;
  std::string group;
  for (const auto& field : fields) {
    const auto dot = field.name.rfind('.');
    const std::string field_group = dot == std::string::npos ? "" : field.name.substr(0, dot);
    if (field_group != group) out += fmt::format("{}{}:\n", out.empty() ? "" : "\n", field_group);
    group = field_group;
    const std::string key = dot == std::string::npos ? field.name : field.name.substr(dot + 1);
    out += fmt::format("{}{}: {}  # {}\n", group.empty() ? "" : "  ", key, field.get(), field.doc);
  }
  return out;
}

}  // namespace idol
