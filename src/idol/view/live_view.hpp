// A run that can be watched in a browser while it goes.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "idol/view/page_server.hpp"
#include "idol/view/sight.hpp"

namespace idol {

/// Takes estimates as they come and never waits for a browser: it keeps the path, the figures of each window
/// and what the newest one shows. Each browser asks for what is new to it, in a thread of its own, thirty
/// times a second at most: one that comes late gets all of it first, a slow one misses pictures but no pose.
class LiveView {
 public:
  /// Serves from now on. `name` is the page's title. Throws UsageError when the port cannot be had (0: any).
  LiveView(std::string name, const Rig& rig, int port);
  /// Says to the browsers that the run is over, if finish() has not.
  ~LiveView();

  /// In any thread, one call at a time.
  void add(const Estimate& estimate, const Sight& sight);
  /// Last message to the browsers, such as where the report is. They get what they have not seen yet, then
  /// the server stops; a browser that takes nothing delays this by about a second.
  void finish(const std::string& words);

  [[nodiscard]] std::string url() const { return server_.url(); }
  [[nodiscard]] int port() const { return server_.port(); }

 private:
  // Figures of a window.
  struct Row {
    Time t = 0;
    double rate = 0, kept = 0, segments = 0, lines = 0, rms = 0, front_ms = 0, solve_ms = 0, speed = 0,
           sigma = 0;
  };
  // What the newest window shows.
  struct Frame {
    Sight sight;
    std::size_t own = 0;  // events of the whole window
  };

  [[nodiscard]] Row row_of(const Estimate& estimate, const Sight& sight);
  void feed(const PageServer::Send& send);
  // What is new since the first `seen` windows, which move on: a message, or a comment if nothing came within
  // a second. Empty: the run is over.
  std::string next(std::size_t& seen);
  [[nodiscard]] std::string hello() const;

  std::string name_;
  Rig rig_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<StampedPose> path_;  // of the camera
  std::vector<Row> rows_;          // as many
  std::shared_ptr<const Frame> frame_;
  SegmenterCounts counts_;
  bool over_ = false;
  std::string last_words_;
  PageServer server_;  // last: its threads use all of the above
};

}  // namespace idol
