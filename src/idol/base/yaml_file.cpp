#include "idol/base/yaml_file.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <fstream>
#include <sstream>

#include "idol/base/diagnostics.hpp"

namespace idol {

YamlNode YamlNode::load(const std::filesystem::path& path) {
  const std::string name = path.string();
  std::ifstream in(path, std::ios::binary);
  std::stringstream content;
  if (!in || !(content << in.rdbuf()) || content.str().empty())
    throw DataError(fmt::format("{}: cannot be read, or is empty", name));
  return parse(content.str(), name);
}

YamlNode YamlNode::parse(std::string text, const std::string& name) {
  if (text.starts_with("%YAML:")) text[0] = '#';  // OpenCV's first line, which is not YAML
  try {
    YAML::Node root = YAML::Load(text);
    if (!root.IsMap()) throw DataError(fmt::format("{}:1: not a YAML file of 'key: value' lines", name));
    return {root, name, ""};
  } catch (const YAML::Exception& e) {
    throw DataError(fmt::format("{}:{}: not valid YAML: {}", name, e.mark.line + 1, e.msg));
  }
}

bool YamlNode::has(const std::string& key) const { return node_.IsMap() && node_[key].IsDefined(); }

YamlNode YamlNode::at(const std::string& key) const {
  if (!node_.IsMap()) refuse("a map of 'key: value' lines is expected");
  if (!has(key)) refuse(fmt::format("key '{}' is missing", key));
  return {node_[key], file_, key};
}

std::string YamlNode::text() const {
  if (!node_.IsScalar()) refuse("a single value is expected");
  return node_.Scalar();
}

std::vector<std::string> YamlNode::keys() const {
  std::vector<std::string> names;
  for (const auto& entry : node_)
    if (entry.first.IsScalar()) names.push_back(entry.first.Scalar());
  return names;
}

std::optional<double> YamlNode::try_number() const {
  if (!node_.IsScalar()) return std::nullopt;
  const std::string value = node_.Scalar();
  const char* begin = value.data();
  const char* end = begin + value.size();
  if (value.size() > 1 && *begin == '+') ++begin;
  double result = 0;
  // Not yaml-cpp's own conversion: that one follows the locale.
  const auto [stop, error] = std::from_chars(begin, end, result);
  if (stop != end || error != std::errc() || !std::isfinite(result)) return std::nullopt;
  return result;
}

double YamlNode::number() const {
  const auto value = try_number();
  if (!value) refuse(fmt::format("'{}' is not a finite number", printable(text())));
  return *value;
}

std::vector<YamlNode> YamlNode::items() const {
  if (!node_.IsSequence()) refuse("a list is expected");
  std::vector<YamlNode> result;
  for (const auto& item : node_) result.push_back({item, file_, key_});
  return result;
}

std::vector<double> YamlNode::numbers() const {
  std::vector<double> result;
  for (const YamlNode& item : items()) result.push_back(item.number());
  return result;
}

std::string YamlNode::where() const { return fmt::format("{}:{}", file_, node_.Mark().line + 1); }

void YamlNode::refuse(const std::string& why) const {
  throw DataError(key_.empty() ? fmt::format("{}: {}", where(), why)
                               : fmt::format("{}: {}: {}", where(), key_, why));
}

}  // namespace idol
