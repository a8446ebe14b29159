#include "idol/view/page_server.hpp"

#include <fmt/format.h>
#include <httplib.h>
#include <sys/socket.h>

#include <atomic>
#include <map>
#include <thread>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

constexpr const char* kHost = "127.0.0.1";
constexpr int kThreads = PageServer::kMostStreams + 6;

// The library's own options would share the port with any other server of theirs.
void set_options(socket_t socket) {
  const int yes = 1;
  setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
}

}  // namespace

struct PageServer::Server {
  struct Resource {
    std::string type;
    Content content;
    std::function<void(const Send&)> feed;
  };

  httplib::Server http;
  int port = 0;
  std::map<std::string, Resource> resources;
  std::atomic<int> streams = 0;
  std::atomic<bool> over = false;  // it does not listen any more, or never did
  std::thread thread;

  [[nodiscard]] bool is_own(const httplib::Request& request) const {
    for (const std::string host : {kHost, "localhost"}) {
      const std::string own = fmt::format("{}:{}", host, port);
      if (request.get_header_value("Host") != own) continue;
      return !request.has_header("Origin") || request.get_header_value("Origin") == "http://" + own;
    }
    return false;
  }

  void answer(const httplib::Request& request, httplib::Response& response) {
    response.set_header("X-Content-Type-Options", "nosniff");
    response.set_header("Cross-Origin-Resource-Policy", "same-origin");
    response.set_header("X-Frame-Options", "DENY");
    response.set_header("Cache-Control", "no-store");
    const auto refuse = [&](int status, const char* why) {
      response.status = status;
      response.set_content(why, "text/plain");
    };
    if (!is_own(request)) return refuse(403, "only for this computer's own page");
    const auto found = resources.find(request.path);
    if (found == resources.end()) return refuse(404, "there is nothing here");
    const Resource& resource = found->second;
    if (resource.feed) return stream(resource, response, refuse);
    try {
      // Not as plain content: that the library would compress, which takes seconds and gains nothing here.
      auto text = std::make_shared<const std::string>(resource.content());
      response.set_content_provider(text->size(), resource.type,
                                    [text](std::size_t offset, std::size_t size, httplib::DataSink& sink) {
                                      return sink.write(text->data() + offset, size);
                                    });
    } catch (const std::exception& e) {
      refuse(500, e.what());
    }
  }

  template <class Refuse>
  void stream(const Resource& resource, httplib::Response& response, const Refuse& refuse) {
    if (++streams > kMostStreams) {
      --streams;
      return refuse(503, "too many browsers are watching");
    }
    response.set_chunked_content_provider(
        resource.type,
        [&resource](std::size_t, httplib::DataSink& sink) {
          resource.feed([&](std::string_view text) {
            return sink.is_writable() && sink.write(text.data(), text.size());
          });
          sink.done();
          return false;  // over
        },
        [this](bool) { --streams; });
  }
};

PageServer::PageServer(int port) : server_(std::make_unique<Server>()) {
  httplib::Server& http = server_->http;
  http.set_socket_options(set_options);
  http.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
  http.set_keep_alive_max_count(1);  // a connection that waits for nothing would delay the end
  http.set_read_timeout(2);
  http.set_write_timeout(1);
  http.set_payload_max_length(0);
  if (port == 0)
    server_->port = http.bind_to_any_port(kHost);
  else if (http.bind_to_port(kHost, port))
    server_->port = port;
  if (server_->port <= 0)
    throw UsageError(
        fmt::format("port {} of {} cannot be had: it is in use, or not allowed; give another one with "
                    "--port, 0 for any that is free",
                    port, kHost));
}

PageServer::~PageServer() { stop(); }

void PageServer::add(const std::string& path, const std::string& type, Content content) {
  server_->resources[path] = {type, std::move(content), {}};
}

void PageServer::add_stream(const std::string& path, std::function<void(const Send&)> feed) {
  server_->resources[path] = {"text/event-stream", {}, std::move(feed)};
}

void PageServer::start() {
  server_->http.Get(".*",
                    [server = server_.get()](const httplib::Request& request, httplib::Response& response) {
                      server->answer(request, response);
                    });
  server_->thread = std::thread([server = server_.get()] {
    server->http.listen_after_bind();
    server->over = true;
  });
  // Only then can it be stopped.
  while (!server_->http.is_running() && !server_->over)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  if (!server_->over) return;
  server_->thread.join();
  throw UsageError(
      fmt::format("port {} of {} does not take connections; give another one with --port", port(), kHost));
}

void PageServer::stop() {
  if (!server_->thread.joinable()) return;
  server_->http.stop();
  server_->thread.join();
}

int PageServer::port() const { return server_->port; }
std::string PageServer::url() const { return fmt::format("http://{}:{}/", kHost, server_->port); }

}  // namespace idol
