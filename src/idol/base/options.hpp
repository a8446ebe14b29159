// Options: each struct lists its fields once, in a static `fields(self, visit)`; loading, dumping, --set, docs and
// range checks all come from that list.
#pragma once

#include <filesystem>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace idol {

/// Inclusive range that a numeric option must lie in.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
};

/// One option seen from outside: dotted name, meaning, and access as text.
struct OptionField {
  std::string name;
  std::string doc;
  std::function<std::string()> get;
  /// Throws UsageError without the option's name: callers add where the value came from.
  std::function<void(const std::string&)> set;
};

namespace detail {
void parse_option(const std::string& text, Range range, bool& out);
void parse_option(const std::string& text, Range range, int& out);
void parse_option(const std::string& text, Range range, double& out);
std::string format_option(bool value);
std::string format_option(int value);
std::string format_option(double value);

/// An enum whose enumerators 0, 1, ... have names in `option_names(T)`, an array found beside the enum.
template <class T>
concept NamedEnum = std::is_enum_v<T> && requires(T t) { option_names(t)[0]; };

/// Position of `text` in `names`. Throws UsageError, listing the names, if it is none of them.
int parse_name(const std::string& text, std::span<const std::string_view> names);
template <NamedEnum T>
void parse_option(const std::string& text, Range, T& out) {
  out = static_cast<T>(parse_name(text, option_names(out)));
}
template <NamedEnum T>
std::string format_option(T value) {
  return std::string(option_names(value)[static_cast<std::size_t>(value)]);
}

template <class T>
concept OptionGroup = requires(T& t) { T::fields(t, [](auto&&...) {}); };
}  // namespace detail

/// Appends the fields of `options` (and of nested groups, dotted) to `out`. The fields refer to `options`.
template <class T>
void list_fields(T& options, std::vector<OptionField>& out, const std::string& prefix = {}) {
  T::fields(options, [&](std::string_view name, auto& value, Range range, std::string_view doc) {
    const std::string full = prefix + std::string(name);
    using Value = std::remove_reference_t<decltype(value)>;
    if constexpr (detail::OptionGroup<Value>) {
      list_fields(value, out, full + ".");
    } else {
      out.push_back({full, std::string(doc), [&value] { return detail::format_option(value); },
                     [&value, range](const std::string& text) { detail::parse_option(text, range, value); }});
    }
  });
}

/// Applies "name=value". `where` starts the message of the UsageError on an unknown name or a bad value.
void set_option(const std::vector<OptionField>& fields, const std::string& name, const std::string& value,
                const std::string& where);

/// Applies every key of a YAML file of nested groups. Throws UsageError with file and line on an unknown key or bad
/// value, DataError if the file cannot be read.
void load_options(const std::vector<OptionField>& fields, const std::filesystem::path& path);

/// All fields as YAML that load_options reads back, each with its meaning as a comment.
std::string dump_options(const std::vector<OptionField>& fields);

}  // namespace idol
