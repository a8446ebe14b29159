#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/view/live_view.hpp"
#include "idol/view/run_server.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using test::TempDir;

/// A browser as far as a test needs one: sends a request, reads what comes.
class Browser {
 public:
  explicit Browser(int port, int receive_buffer = 0) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    if (receive_buffer > 0)
      setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    const timeval patience{5, 0};
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
    connected_ = ::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    host_ = "127.0.0.1:" + std::to_string(port);
  }
  ~Browser() { ::close(socket_); }
  Browser(const Browser&) = delete;
  Browser& operator=(const Browser&) = delete;

  [[nodiscard]] bool connected() const { return connected_; }
  void ask(const std::string& path, const std::string& headers = {}, std::string host = {}) {
    if (host.empty()) host = host_;
    const std::string text = "GET " + path + " HTTP/1.1\r\nHost: " + host + "\r\n" + headers + "\r\n";
    ::send(socket_, text.data(), text.size(), MSG_NOSIGNAL);
  }
  /// Everything up to and with `mark`, or to the end; what lies behind the mark stays.
  std::string read_until(const std::string& mark) {
    char buffer[65536];
    while (rest_.find(mark) == std::string::npos) {
      const auto n = ::recv(socket_, buffer, sizeof buffer, 0);
      if (n <= 0) return std::exchange(rest_, {});
      rest_.append(buffer, static_cast<std::size_t>(n));
    }
    const std::size_t end = rest_.find(mark) + mark.size();
    std::string text = rest_.substr(0, end);
    rest_.erase(0, end);
    return text;
  }
  std::string read_all() { return read_until("no such text"); }
  /// The data of the next message of this name.
  nlohmann::json message(const std::string& name) {
    read_until("event: " + name + "\ndata: ");
    const std::string text = read_until("\n\n");
    return nlohmann::json::parse(text, nullptr, false);
  }

 private:
  int socket_;
  bool connected_ = false;
  std::string host_, rest_;
};

std::string answer_of(int port, const std::string& path, const std::string& headers = {},
                      const std::string& host = {}) {
  Browser browser(port);
  browser.ask(path, headers, host);
  return browser.read_all();
}

class NoBackend : public Backend {
 public:
  explicit NoBackend(const Rig& rig) : Backend(rig, 9.81) {}
  void start(const NavState&, bool) override {}
  void add(WindowMeasurement) override {}
  SolveStats solve() override { return {}; }
  [[nodiscard]] std::vector<Line> lines() const override { return {}; }
  [[nodiscard]] std::size_t line_count() const override { return 0; }
};

Rig live_rig() {
  Rig rig;
  rig.camera = {240, 180, 200, 200, 120, 90, Distortion::kNone, {}};
  return rig;
}

/// Gives a view windows of 50 ms, 2000 events each.
class Driver {
 public:
  explicit Driver(LiveView& view) : view_(view) {
    for (int i = 0; i < 2000; ++i)
      sight_.events.push_back({{static_cast<float>(i % 240), static_cast<float>(i % 180)}, i % 20, true});
    for (int i = 0; i < 20; ++i) sight_.lines.push_back({i, {0, 0, 1}, {1, 0, 1}, 0, 1, 5, 100});
  }
  void add(int windows) {
    for (int k = 0; k < windows; ++k, ++count_) {
      window_.begin = Time{50'000'000} * count_;
      window_.end = sight_.t = window_.begin + 50'000'000;
      NavState state;
      state.t = window_.end;
      state.T_w_i.p.x() = count_;
      SegmenterCounts counts;
      counts.events = 2000 * (count_ + 1);
      counts.in_segments = 1500 * (count_ + 1);
      view_.add({state, window_, segments_, backend_, {}, 0.01, 0.001, 0.02, counts}, sight_);
    }
  }

 private:
  LiveView& view_;
  NoBackend backend_{live_rig()};
  EventWindow window_;
  SegmentedWindow segments_;
  Sight sight_;
  std::int64_t count_ = 0;
};

TEST(LiveView, ALateBrowserGetsThePresentStateThenWhatIsNew) {
  LiveView view("run", live_rig(), 0);
  Driver driver(view);
  driver.add(50);
  Browser browser(view.port());
  browser.ask("/stream");
  const auto hello = browser.message("hello");
  EXPECT_EQ(hello["name"], "run");
  EXPECT_EQ(hello["camera"]["width"], 240);
  EXPECT_EQ(hello["palette"].size(), 12U);
  auto update = browser.message("update");
  EXPECT_EQ(update["reset"], true);
  EXPECT_EQ(update["path"]["t"].size(), 50U);
  EXPECT_EQ(update["path"]["p"][3 * 49], 49);
  EXPECT_EQ(update["rows"]["kept"][10], 75);
  EXPECT_EQ(update["rows"]["rate"][10], 40) << "thousand events a second";
  EXPECT_EQ(update["lines"]["id"].size(), 20U);
  EXPECT_EQ(update["events"]["shown"], 2000);
  driver.add(1);
  update = browser.message("update");
  EXPECT_EQ(update["reset"], false);
  EXPECT_EQ(update["path"]["t"].size(), 1U);
  EXPECT_EQ(update["path"]["p"][0], 50);
  view.finish("words");
  EXPECT_EQ(browser.message("end"), "words");
  EXPECT_FALSE(Browser(view.port()).connected());
}

TEST(LiveView, ALongRunComesThinnedToALateBrowser) {
  LiveView view("run", live_rig(), 0);
  Driver driver(view);
  driver.add(9000);
  Browser browser(view.port());
  browser.ask("/stream");
  const auto update = browser.message("update");
  EXPECT_LE(update["path"]["t"].size(), 4000U);
  EXPECT_GE(update["path"]["t"].size(), 2000U);
  EXPECT_EQ(update["path"]["p"][3 * (update["path"]["t"].size() - 1)], 8999) << "the newest is among them";
  EXPECT_LE(update["rows"]["t"].size(), 201U) << "ten seconds";
}

TEST(LiveView, ThirtyUpdatesASecondAtMostAndNoPoseMissed) {
  LiveView view("run", live_rig(), 0);
  Driver driver(view);
  driver.add(1);
  Browser browser(view.port());
  browser.ask("/stream");
  browser.message("update");
  const auto begin = Clock::now();
  for (int i = 0; i < 200; ++i) {
    driver.add(1);
    std::this_thread::sleep_for(2ms);
  }
  const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  view.finish("");
  int updates = 0;
  std::size_t poses = 1;
  while (true) {
    const auto update = browser.message("update");
    if (update.is_discarded()) break;
    ++updates;
    poses += update["path"]["t"].size();
  }
  EXPECT_EQ(poses, 201U);
  EXPECT_LE(updates, 30 * seconds + 3);
}

TEST(LiveView, ABrowserThatTakesNothingDelaysNothing) {
  LiveView view("run", live_rig(), 0);
  Driver driver(view);
  driver.add(1);
  Browser stalled(view.port(), 2048);
  stalled.ask("/stream");  // and never reads
  stalled.read_until("event: hello");
  auto worst = Clock::duration::zero();
  for (int i = 0; i < 500; ++i) {
    const auto begin = Clock::now();
    driver.add(1);
    worst = std::max(worst, Clock::now() - begin);
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_LT(worst, 100ms);
  const auto begin = Clock::now();
  view.finish("");
  EXPECT_LT(Clock::now() - begin, 4s);
}

TEST(LiveView, EndsWithoutABrowser) {
  const auto begin = Clock::now();
  {
    LiveView view("run", live_rig(), 0);
    Driver(view).add(10);
  }
  EXPECT_LT(Clock::now() - begin, 1s);
}

TEST(PageServer, IsBoundToLoopbackAlone) {
  PageServer server(0);
  server.start();
  std::ifstream sockets("/proc/net/tcp");
  ASSERT_TRUE(sockets);
  char wanted[32];
  std::snprintf(wanted, sizeof wanted, ":%04X", static_cast<unsigned>(server.port()));
  int listening = 0;
  for (std::string line; std::getline(sockets, line);) {
    if (line.find(std::string(wanted) + " 00000000:0000 0A") == std::string::npos) continue;
    ++listening;
    EXPECT_NE(line.find("0100007F" + std::string(wanted)), std::string::npos) << line;
  }
  EXPECT_EQ(listening, 1);
}

TEST(PageServer, APortInUseIsOneClearError) {
  const PageServer first(0);
  const std::string port = std::to_string(first.port());
  try {
    const PageServer second(first.port());
    ADD_FAILURE() << "two servers on one port";
  } catch (const UsageError& e) {
    test::expect_says(e.what(), {port, "in use", "--port"});
  }
  const TempDir dir;
  const auto run = test::run_idol("run " IDOL_DATA_DIR "/shapes_demo --to 0.2 --view --port " + port +
                                  " --out " + (dir.path() / "out").string());
  EXPECT_EQ(run.status, 2);
  EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
  test::expect_says(run.err, {"idol: port " + port, "in use"});
}

TEST(PageServer, ServesOnlyItsOwnPagesToItsOwnPage) {
  PageServer server(0);
  server.add("/", "text/html", [] { return std::string("the page"); });
  server.add("/broken", "text/html", []() -> std::string { throw DataError("the folder is gone"); });
  server.start();
  const int port = server.port();
  const std::string own = "127.0.0.1:" + std::to_string(port);
  test::expect_says(answer_of(port, "/"), {"HTTP/1.1 200", "the page", "nosniff"});
  test::expect_says(answer_of(port, "/", "Origin: http://" + own + "\r\n"), {"200"});
  test::expect_says(answer_of(port, "/", {}, "localhost:" + std::to_string(port)), {"200"});
  test::expect_says(answer_of(port, "/", "Accept-Encoding: gzip, br\r\n"),
                    {"Content-Length: 8\r\n", "the page"});
  test::expect_says(answer_of(port, "/broken"), {"500", "the folder is gone"});
  for (const char* path :
       {"/../../etc/passwd", "/%2e%2e/etc/passwd", "//etc/passwd", "/runs/0/../../data", "/x"})
    test::expect_says(answer_of(port, path), {"HTTP/1.1 404"});
  for (const char* origin : {"http://example.org", "null", "http://localhost:1"})
    test::expect_says(answer_of(port, "/", "Origin: " + std::string(origin) + "\r\n"), {"HTTP/1.1 403"});
  for (const char* host : {"example.org", "127.0.0.1", "evil.org:80"})
    test::expect_says(answer_of(port, "/", {}, host), {"HTTP/1.1 403"});
}

TEST(PageServer, HasRoomForSomeStreams) {
  PageServer server(0);
  std::atomic<bool> over = false;
  server.add_stream("/stream", [&](const PageServer::Send& send) {
    send("here\n\n");
    while (!over) std::this_thread::sleep_for(1ms);
  });
  server.add("/", "text/plain", [] { return std::string("page"); });
  server.start();
  std::vector<std::unique_ptr<Browser>> browsers;
  for (int i = 0; i < PageServer::kMostStreams; ++i) {
    browsers.push_back(std::make_unique<Browser>(server.port()));
    browsers.back()->ask("/stream");
    test::expect_says(browsers.back()->read_until("here"), {"200", "text/event-stream"});
  }
  test::expect_says(answer_of(server.port(), "/stream"), {"503"});
  test::expect_says(answer_of(server.port(), "/"), {"200"});
  over = true;
  server.stop();
}

TEST(RunServer, ServesEveryRun) {
  const TempDir dir;
  const auto add_run = [&](const char* name, const char* sequence) {
    std::filesystem::create_directories(dir.path() / name);
    dir.write(std::string(name) + "/stats.json", std::string(R"({"sequence": ")") + sequence + "\"}");
    return dir.path() / name;
  };
  const auto a = add_run("one/out", "first"), b = add_run("two/out", "second");
  const RunServer server({a, b}, 0);
  test::expect_says(answer_of(server.port(), "/"),
                    {R"("kind":"runs")", R"("name":"one/out")", R"("name":"two/out")"});
  test::expect_says(answer_of(server.port(), "/runs/1/data.json"), {"200", R"("sequence":"second")"});
  test::expect_says(answer_of(server.port(), "/runs/0/events.bin"), {"200"});
  test::expect_says(answer_of(server.port(), "/runs/2/data.json"), {"404"});
  EXPECT_THROW(RunServer({a, dir.path() / "none"}, 0), DataError);
  const auto wrong = test::run_idol("view " + dir.path().string());
  EXPECT_EQ(wrong.status, 1);
  test::expect_says(wrong.err, {"nothing of a run"});
}

TEST(RunServer, NamesThatTellTheFoldersApart) {
  using Names = std::vector<std::string>;
  EXPECT_EQ(distinct_names({"/a/x", "/a/y/"}), (Names{"x", "y"}));
  EXPECT_EQ(distinct_names({"/a/out", "/b/out", "/c/z"}), (Names{"a/out", "b/out", "c/z"}));
  EXPECT_EQ(distinct_names({"/a/out", "/a/out"}), (Names{"out", "out"}));
}

TEST(LiveViewPipeline, TheRunDoesNotNeedABrowser) {
  const TempDir dir;
  const auto run = test::run_idol("run " IDOL_DATA_DIR "/shapes_demo --to 1 --view --out " +
                                  (dir.path() / "out").string());
  EXPECT_EQ(run.status, 0) << run.err;
  test::expect_says(run.err, {"http://127.0.0.1:"});
  EXPECT_TRUE(std::filesystem::exists(dir.path() / "out" / "report.html"));
  EXPECT_EQ(test::run_idol("run x --out y --port 8000").status, 2) << "--port is of --view";
}

}  // namespace
}  // namespace idol
