// A small web server for one page and its data, for browsers on this computer only.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>

namespace idol {

/// Listens on 127.0.0.1 and answers only what it was given: known paths, asked for by their own page.
/// Requests that name another host (a foreign name that leads here) or come from another origin are refused.
class PageServer {
 public:
  /// Bound at once, so that the port is known. Port 0: any free one. Throws UsageError when the port cannot
  /// be had.
  explicit PageServer(int port);
  /// Stops; waits for answers that are being written, a second at most for a browser that does not take them.
  ~PageServer();
  PageServer(const PageServer&) = delete;
  PageServer& operator=(const PageServer&) = delete;

  /// Called for each request, in any thread, several at a time. What it throws is answered as an error.
  using Content = std::function<std::string()>;
  void add(const std::string& path, const std::string& type, Content content);
  /// Sends text to one browser; false once it is gone, or has taken nothing for a second.
  using Send = std::function<bool(std::string_view)>;
  /// Called for each browser, in a thread of its own, until it returns. Not more than kMostStreams at a time.
  void add_stream(const std::string& path, std::function<void(const Send&)> feed);
  static constexpr int kMostStreams = 8;

  /// All paths have been added: answers from now on, in threads of its own.
  void start();
  void stop();

  [[nodiscard]] int port() const;
  [[nodiscard]] std::string url() const;

 private:
  struct Server;
  std::unique_ptr<Server> server_;
};

}  // namespace idol
