// RPG-style recordings: events.txt and imu.txt side by side, each plain or compressed.
#pragma once

#include <cstdint>
#include <exception>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "idol/io/reader.hpp"
#include "idol/io/row_stream.hpp"

namespace idol {

class TextReader : public Reader {
 public:
  /// A recording's folder, or an events file (the IMU is then looked for beside it). Throws DataError.
  TextReader(const std::filesystem::path& path, const ReaderOptions& options);

  std::optional<Packet> next() override;
  [[nodiscard]] bool imu_over() const override { return !imu_ || !imu_->head; }
  [[nodiscard]] Time first_stamp() const override { return first_stamp_; }
  [[nodiscard]] double progress() const override;
  [[nodiscard]] const Diagnostics& diagnostics() const override { return diagnostics_; }

 private:
  /// A stream with its next row in view.
  template <class Parser>
  struct Cursor {
    RowStream<Parser> stream;
    std::optional<typename Parser::Row> head;  ///< nothing: the stream is over, by its end or by damage
    std::exception_ptr damage;

    void advance();
    [[nodiscard]] const std::string& name() const { return stream.lines().name(); }
  };
  template <class Parser>
  std::unique_ptr<Cursor<Parser>> open(const std::filesystem::path& folder, const std::string& name,
                                       Parser parser);
  template <class Parser>
  std::unique_ptr<Cursor<Parser>> open(const std::filesystem::path& file, Parser parser);

  void fill_events();
  bool fill_imu(std::vector<ImuSample>& imu, Time until);
  [[nodiscard]] Time imu_begin() const;
  [[nodiscard]] Time imu_end() const;
  void check_overlap() const;
  std::optional<Packet> end() const;
  [[nodiscard]] std::string span_of_events() const;

  ReaderOptions options_;
  Diagnostics diagnostics_;
  std::unique_ptr<Cursor<EventParser>> events_;
  std::unique_ptr<Cursor<ImuParser>> imu_;  // none: events alone
  Time imu_offset_ = 0;
  Time first_stamp_ = 0;
  Time begin_ = 0;  // span [begin, end)
  Time end_ = 0;
  std::vector<Event> waiting_;  // events of the next packet, until their IMU samples are there too
  bool events_over_ = false;
  std::optional<Time> first_event_, first_imu_;  // of the span; the IMU's on the clock of the camera
  Time last_event_ = 0, last_imu_ = 0;
};

}  // namespace idol
