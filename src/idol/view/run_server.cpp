#include "idol/view/run_server.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>
#include <set>

#include "idol/report/page_data.hpp"
#include "idol/report/page_json.hpp"
#include "idol/report/report.hpp"

namespace idol {

struct RunServer::Run {
  std::filesystem::path dir;
  std::mutex mutex;
  std::string events;  // that belong to the data sent last

  std::string data() {
    PageData data = page_data(read_run_folder(dir));
    const std::lock_guard lock(mutex);
    events = std::move(data.events);
    return std::move(data.json);
  }
  std::string packed_events() {
    const std::lock_guard lock(mutex);
    return events;
  }
};

RunServer::RunServer(const std::vector<std::filesystem::path>& dirs, int port) : server_(port) {
  const std::vector<std::string> names = distinct_names(dirs);
  Json source{{"kind", "runs"}, {"runs", Json::array()}};
  for (std::size_t i = 0; i < dirs.size(); ++i) {
    read_run_folder(dirs[i]);  // so that a wrong folder is known now
    source["runs"].push_back({{"name", names[i]}});
    Run* run = runs_.emplace_back(std::make_unique<Run>()).get();
    run->dir = dirs[i];
    server_.add(fmt::format("/runs/{}/data.json", i), "application/json", [run] { return run->data(); });
    server_.add(fmt::format("/runs/{}/events.bin", i), "application/octet-stream",
                [run] { return run->packed_events(); });
  }
  server_.add("/", "text/html", [text = safe_text(source)] { return page_with(text); });
  server_.start();
}

RunServer::~RunServer() { server_.stop(); }

std::vector<std::string> distinct_names(const std::vector<std::filesystem::path>& dirs) {
  std::vector<std::filesystem::path> whole;
  for (const auto& dir : dirs) {
    whole.push_back(std::filesystem::weakly_canonical(dir));
    if (!whole.back().has_filename()) whole.back() = whole.back().parent_path();
  }
  std::vector<std::string> names;
  for (int parts = 1; parts < 64; ++parts) {
    names.clear();
    for (const auto& path : whole) {
      const auto from = std::next(
          path.begin(), std::max<std::ptrdiff_t>(0, std::distance(path.begin(), path.end()) - parts));
      std::filesystem::path name;
      std::for_each(from, path.end(), [&](const auto& part) { name /= part; });
      names.push_back(name.string());
    }
    if (std::set(names.begin(), names.end()).size() == std::set(whole.begin(), whole.end()).size()) break;
  }
  return names;
}

}  // namespace idol
