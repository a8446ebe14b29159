// Finished runs in a browser: the page of one, or several beside each other.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "idol/view/page_server.hpp"

namespace idol {

class RunServer {
 public:
  /// Serves from now on. A run's folder is read when a browser asks for it, and again each time the page is
  /// loaded. Throws DataError for a folder that holds nothing of a run, UsageError when the port cannot be
  /// had.
  RunServer(const std::vector<std::filesystem::path>& dirs, int port);
  ~RunServer();

  [[nodiscard]] std::string url() const { return server_.url(); }
  [[nodiscard]] int port() const { return server_.port(); }

 private:
  struct Run;

  std::vector<std::unique_ptr<Run>> runs_;
  PageServer server_;  // last: its threads use the above
};

/// What to call each folder: its own name, with those of the folders above where that is not enough.
std::vector<std::string> distinct_names(const std::vector<std::filesystem::path>& dirs);

}  // namespace idol
