"""The commands of the protocol."""

from links import MAX_LINE, MAX_WIFI_LINE

_HELP = "frames, plain, rate N, channels N, average N, led N, led on, led off, version, help"
_MAX_DIGITS = 5


def execute(board, link):
    """Carry out the line that a link has received, and answer: an info, or a text if refused."""
    line = link.line.read_line()
    word = line.partition(" ")[0]
    is_wifi_command = board.wifi is not None and word in board.wifi.commands
    if is_wifi_command and not link.is_local:
        board.send_text(link, f"{word} is accepted over USB only")
    elif is_wifi_command and link.line.is_bad:
        board.send_text(link, f"{word} has at most {MAX_WIFI_LINE} printable characters")
    elif is_wifi_command:
        board.send_text(link, board.wifi.execute(line))
    elif link.line.is_bad or len(line) > MAX_LINE:
        board.send_text(link, f"a command has at most {MAX_LINE} printable characters")
    elif line == "help":
        board.send_text(link, _HELP)
    elif _execute_setting(board, link, line):
        board.send_info(link)


def _execute_setting(board, link, line):
    """Carry out a command that is answered by an info; return False if it was refused."""
    if line == "frames":
        link.start_frames()
    elif line == "plain":
        link.start_plain()
    elif line == "led on":
        board.hold_led(True)
    elif line == "led off":
        board.hold_led(False)
    elif line != "version":
        return _execute_number(board, link, line)
    return True


def _execute_number(board, link, line):
    """Carry out a command with a number; return False if it was refused."""
    word, _, digits = line.partition(" ")
    limits = {
        "rate": (1, 500),
        "channels": (1, board.max_channels),
        "average": (1, 255),
        "led": (0, 65535),
    }.get(word)
    if limits is None:
        board.send_text(link, "unknown command, try help")
        return False
    low, high = limits
    value = int(digits) if digits.isdigit() and len(digits) <= _MAX_DIGITS else -1
    if not low <= value <= high:
        alternative = ", on or off" if word == "led" else ""
        board.send_text(link, f"{word} takes {low} to {high}{alternative}")
        return False
    if word == "rate":
        board.set_rate(value)
    elif word == "channels":
        board.settings.channels = value
    elif word == "average":
        board.settings.averages = value
    else:
        board.blink_led(value)
    return True
