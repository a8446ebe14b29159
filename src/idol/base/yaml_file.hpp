// YAML read strictly: every complaint names file and line.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace idol {

/// One node of a YAML file together with the file's name.
class YamlNode {
 public:
  /// The root of a file. Throws DataError if it cannot be read or is not YAML.
  static YamlNode load(const std::filesystem::path& path);
  /// The same of text in memory, called `name` in messages.
  static YamlNode parse(std::string text, const std::string& name);

  [[nodiscard]] bool has(const std::string& key) const;
  [[nodiscard]] bool is_list() const { return node_.IsSequence(); }
  [[nodiscard]] bool is_map() const { return node_.IsMap(); }
  /// The keys of a map, in the order of the file.
  [[nodiscard]] std::vector<std::string> keys() const;
  /// The key by which this node was reached.
  [[nodiscard]] const std::string& key() const { return key_; }
  /// The value if it is a finite number.
  [[nodiscard]] std::optional<double> try_number() const;
  /// The value of a key of this map. Throws DataError if it is not there.
  [[nodiscard]] YamlNode at(const std::string& key) const;
  /// The value as a finite number, as text, as a list of finite numbers, as its items. Each throws DataError.
  [[nodiscard]] double number() const;
  [[nodiscard]] std::string text() const;
  [[nodiscard]] std::vector<double> numbers() const;
  [[nodiscard]] std::vector<YamlNode> items() const;

  [[nodiscard]] const std::string& file() const { return file_; }
  /// "file:line" of the node.
  [[nodiscard]] std::string where() const;
  /// Throws DataError with the node's place before the message.
  [[noreturn]] void refuse(const std::string& why) const;

 private:
  YamlNode(const YAML::Node& node, std::string file, std::string key)
      : node_(node), file_(std::move(file)), key_(std::move(key)) {}

  YAML::Node node_;
  std::string file_;
  std::string key_;  // by which the node was reached, for messages
};

}  // namespace idol
