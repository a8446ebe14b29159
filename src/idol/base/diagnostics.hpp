// How trouble is told: errors are thrown, survivable oddities are counted. The library never prints.
#pragma once

#include <cstdint>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>

namespace idol {

/// Bad data from outside (file, rig, recording). The message says what, where (file:line) and what to do.
class DataError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Wrong usage: unknown option, value out of range. The message says which and what would be right.
class UsageError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A piece of foreign text that may stand in a message: short, one line, printable.
inline std::string printable(std::string_view text) {
  constexpr std::size_t kLongest = 40;
  std::string shown(text.substr(0, kLongest));
  for (char& c : shown)
    if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7e) c = '?';
  return text.size() > kLongest ? shown + "..." : shown;
}

/// Survivable oddities by kind; each kind keeps its first message and a count.
class Diagnostics {
 public:
  struct Entry {
    std::string first_message;
    std::int64_t count = 0;
  };

  void warn(const std::string& kind, const std::string& message, std::int64_t count = 1) {
    Entry& entry = entries_[kind];
    if (entry.count == 0) entry.first_message = message;
    entry.count += count;
  }
  /// For what is known better as time goes on: takes the place of what was said before.
  void replace(const std::string& kind, const std::string& message, std::int64_t count) {
    entries_[kind] = {message, count};
  }
  void merge(const Diagnostics& other) {
    for (const auto& [kind, entry] : other.entries_) warn(kind, entry.first_message, entry.count);
  }
  /// The same, but for kinds that were counted here already.
  void merge_new(const Diagnostics& other) {
    entries_.insert(other.entries_.begin(), other.entries_.end());
  }
  [[nodiscard]] const std::map<std::string, Entry>& entries() const { return entries_; }

 private:
  std::map<std::string, Entry> entries_;
};

}  // namespace idol
